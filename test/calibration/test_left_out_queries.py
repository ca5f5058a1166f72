"""Each scan is searched in both halves of another drive's map, and counted once."""

from __future__ import annotations

import numpy as np
import pytest
from encoded_streets import encoded_street as street

from offradar_ros.calibration.left_out_queries import left_out_queries
from offradar_ros.errors import DataError


def test_each_scan_is_searched_in_both_halves_as_in_a_loop() -> None:
    drives = [street(index, count) for index, count in enumerate((70, 60, 50))]
    drives[1].uncertainties[4], drives[1].means[4] = np.inf, np.nan
    queries = left_out_queries(drives, 5.0, 25.0)
    assert (len(queries), queries.scans, queries.refused, queries.drives) == (358, 180, 1, 3)
    found: dict[int, list[int]] = {}
    for row in range(len(queries)):
        found.setdefault(int(queries.scan[row]), []).append(row)
    scan = 0
    for query in drives:
        others = [drive for drive in drives if drive is not query]
        for turn, index in enumerate(np.flatnonzero(query.usable)):
            mapped, here = others[turn % 2], query.poses[index, :2]
            middle_m = mapped.driven_m[-1] / 2.0
            rows = mapped.map_rows(5.0)
            answers = set()
            for half in (rows[mapped.driven_m[rows] < middle_m], rows[mapped.driven_m[rows] >= middle_m]):
                apart_m = np.hypot(*(mapped.poses[half, :2] - here).T)
                nearest = int(np.argmin(np.linalg.norm(mapped.means[half] - query.means[index], axis=1)))
                answers.add((bool(apart_m[nearest] <= 25.0), bool(apart_m.min() <= 25.0)))
            assert {(bool(queries.right[row]), bool(queries.on_map[row])) for row in found[scan]} == answers
            scan += 1


def test_counted_once_and_about_half_of_them_off_the_map() -> None:
    queries = left_out_queries([street(index, 400) for index in range(3)], 5.0, 25.0)
    assert sorted(queries.scan[queries.mixed].tolist()) == list(range(1200))
    assert np.mean(queries.on_map[queries.mixed]) == pytest.approx(0.5, abs=0.05)
    off = queries.off_map
    assert not queries.on_map[off].any()
    assert len(set(queries.scan[off].tolist())) == len(off) > 1100
    # Off the map, no answer can be right.
    assert not queries.right[off].any()


def test_a_road_too_short_to_leave_a_half_out_is_refused() -> None:
    with pytest.raises(DataError, match=r'street_1, street_2: with a half of each map left out, expected .* further'):
        left_out_queries([street(index, 9) for index in range(2)], 5.0, 25.0)
