"""Every scan counts once, in the map of another drive."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from encoded_streets import encoded_street as street

from offradar_ros.calibration.validation_queries import validation_queries
from offradar_ros.errors import DataError


def test_scans_take_the_maps_of_the_others_in_turn_as_in_a_loop() -> None:
    drives = [street(index, count) for index, count in enumerate((70, 60, 50))]
    drives[1].uncertainties[4], drives[1].means[4] = np.inf, np.nan
    queries = validation_queries(drives, 5.0, 25.0)
    assert (len(queries), queries.drives, queries.refused) == (180, 3, 1)
    row = 0
    for query in drives:
        others = [drive for drive in drives if drive is not query]
        for scan in range(len(query)):
            mapped = others[scan % 2]
            here = query.poses[scan, :2]
            cells: dict[int, int] = {}
            for place in np.flatnonzero(mapped.usable):
                cells.setdefault(int(mapped.driven_m[place] // 5.0), int(place))
            places = list(cells.values())
            apart_m = [float(np.hypot(*(mapped.poses[p, :2] - here))) for p in places]
            nearest = int(np.argmin([np.linalg.norm(mapped.means[p] - query.means[scan]) for p in places]))
            wrong = not np.isfinite(query.uncertainties[scan]) or apart_m[nearest] > 25.0
            assert queries.wrong[row] == wrong
            assert queries.positive[row] == (min(apart_m) <= 25.0)
            row += 1
    assert 0 < queries.wrong.sum() < 90


def test_the_drives_share_the_squares_of_ground() -> None:
    first, second = (street(index, 60) for index in range(2))
    squares = validation_queries([first, second], 5.0, 25.0).squares
    assert squares[:60].tolist() == squares[60:].tolist() == [i // 25 for i in range(60)]


def test_a_scan_far_from_the_other_drive_has_no_right_place() -> None:
    long, short = street(0, 100), street(1, 50)
    queries = validation_queries([long, short], 5.0, 25.0)
    assert queries.positive[:100].tolist() == [4.0 * i <= 195.0 + 25.0 for i in range(100)]
    assert queries.wrong[:100][~queries.positive[:100]].all()


def test_drives_of_different_roads_are_refused() -> None:
    first, second = (street(index, 30) for index in range(2))
    aside_m = np.array([0.0, 500.0, 0.0])
    away = dataclasses.replace(second, poses=second.poses + aside_m)
    with pytest.raises(DataError, match='street_1, street_2: no scan is within 25 m of another drive'):
        validation_queries([first, away], 5.0, 25.0)
