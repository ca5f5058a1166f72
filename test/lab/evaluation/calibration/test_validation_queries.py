"""Every scan counts once, in the map of another drive."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.calibration.validation_queries import validation_queries
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive

Street = Callable[..., EmbeddedDrive]


def test_scans_are_dealt_to_the_maps_of_the_others_as_in_a_loop(embedded_street: Street) -> None:
    drives = [embedded_street(index, count) for index, count in enumerate((70, 60, 50))]
    drives[1].uncertainties[4], drives[1].means[4] = np.inf, np.nan
    queries = validation_queries(drives, 5.0, 25.0)
    assert (len(queries), queries.drives, queries.refused) == (180, 3, 1)
    row = 0
    for query in drives:
        others = [drive for drive in drives if drive is not query]
        for scan in range(len(query.drive)):
            mapped = others[scan % 2]
            here = query.drive.poses[scan, :2]
            cells: dict[int, int] = {}
            for place in np.flatnonzero(mapped.usable):
                cells.setdefault(int(mapped.drive.driven_m[place] // 5.0), int(place))
            places = list(cells.values())
            apart_m = [float(np.hypot(*(mapped.drive.poses[p, :2] - here))) for p in places]
            nearest = int(np.argmin([np.linalg.norm(mapped.means[p] - query.means[scan]) for p in places]))
            wrong = not np.isfinite(query.uncertainties[scan]) or apart_m[nearest] > 25.0
            assert queries.wrong[row] == wrong
            assert queries.positive[row] == (min(apart_m) <= 25.0)
            row += 1
    assert 0 < queries.wrong.sum() < 90


def test_the_drives_share_the_squares_of_ground(embedded_street: Street) -> None:
    first, second = (embedded_street(index, 60) for index in range(2))
    squares = validation_queries([first, second], 5.0, 25.0).squares
    assert squares[:60].tolist() == squares[60:].tolist() == [i // 25 for i in range(60)]


def test_a_scan_far_from_the_other_drive_has_no_right_place(embedded_street: Street) -> None:
    long, short = embedded_street(0, 100), embedded_street(1, 50)
    queries = validation_queries([long, short], 5.0, 25.0)
    assert queries.positive[:100].tolist() == [4.0 * i <= 195.0 + 25.0 for i in range(100)]
    assert queries.wrong[:100][~queries.positive[:100]].all()


def test_drives_of_different_roads_are_refused(embedded_street: Street) -> None:
    first, second = (embedded_street(index, 30) for index in range(2))
    aside_m = np.array([0.0, 500.0, 0.0])
    away = dataclasses.replace(second, drive=dataclasses.replace(second.drive, poses=second.drive.poses + aside_m))
    with pytest.raises(DataError, match='street_1, street_2: no scan is within 25 m of another drive'):
        validation_queries([first, away], 5.0, 25.0)


def test_a_drive_that_cannot_be_encoded_is_named(embedded_street: Street) -> None:
    first, second = (embedded_street(index, 30) for index in range(2))
    second.uncertainties[:] = np.inf
    with pytest.raises(DataError, match='street_2: none of its 30 scans can be encoded'):
        validation_queries([first, second], 5.0, 25.0)
