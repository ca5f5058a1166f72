"""Searches of one drive in the map of another, against plain loops."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.lab.evaluation.answers import DEPTH, NOT_FOUND, Pair, Rules, map_rows, search_drive_map
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive

Street = Callable[..., EmbeddedDrive]


def test_answers_against_a_loop(embedded_street: Street) -> None:
    mapped, query = embedded_street(0, 40), embedded_street(1, 55)
    # The query drive continues for 16 scans beyond the map, the last ten of them farther than 25 m.
    found = search_drive_map(Pair('m', 'g', 'street', 0, 1, 12.0), mapped, query, Rules())
    rows = map_rows(mapped, 12.0)
    assert rows.tolist() == list(range(0, 40, 3))
    for scan in range(55):
        order = sorted(rows, key=lambda r: float(np.linalg.norm(mapped.means[r] - query.means[scan])))
        errors = [np.hypot(*(mapped.drive.poses[r] - query.drive.poses[scan])[:2]) for r in order]
        positives = [k for k, error in enumerate(errors[:DEPTH]) if error <= 25.0]
        assert found.ranks[scan] == (positives[0] if positives else NOT_FOUND)
        assert found.errors_m[scan] == pytest.approx(errors[0])
        assert found.positive[scan] == (min(errors) <= 25.0)
        assert found.found[scan] == order[0]
        assert found.nearest[scan] == min(rows, key=lambda r: abs(4.0 * r - 4.0 * scan))
    assert found.places == len(rows)
    assert not found.positive[-1]


def test_a_refused_scan_is_not_mapped_and_counts_as_wrong(embedded_street: Street) -> None:
    whole = embedded_street(0, 30)
    means, uncertainties = whole.means.copy(), whole.uncertainties.copy()
    means[[0, 7]], uncertainties[[0, 7]] = np.nan, np.inf
    refused = dataclasses.replace(whole, means=means, uncertainties=uncertainties)
    assert map_rows(refused, 12.0)[0] == 1
    found = search_drive_map(Pair('m', 'g', 'street', 0, 0, 12.0), whole, refused, Rules())
    assert not found.correct[[0, 7]].any()
    assert found.correct[10]
    # Its positive pairs are missed at every threshold, so that recall ends below 1.
    level, complete = (
        search_drive_map(Pair('m', 'g', 'street', 0, 0, 12.0), whole, d, Rules()) for d in (refused, whole)
    )
    assert level.pair_level is not None
    assert complete.pair_level is not None
    assert level.pair_level.average_precision < complete.pair_level.average_precision
    assert level.pair_level.precisions[-1] == 0.0 < complete.pair_level.precisions[-1]


def test_queries_have_a_positive_where_the_scan_of_the_place_was_refused(embedded_street: Street) -> None:
    mapped, query = embedded_street(0, 40), embedded_street(1, 40)
    uncertainties = mapped.uncertainties.copy()
    uncertainties[:35] = np.inf
    refused = dataclasses.replace(mapped, uncertainties=uncertainties)
    pair = Pair('m', 'g', 'street', 0, 1, 12.0)
    found, whole = (search_drive_map(pair, drive, query, Rules()) for drive in (refused, mapped))
    assert (found.places, whole.places) == (3, 14)
    np.testing.assert_array_equal(found.positive, whole.positive)
    assert not found.correct[:20].any()
    nothing = dataclasses.replace(mapped, uncertainties=np.full(40, np.inf))
    empty = search_drive_map(pair, nothing, query, Rules())
    assert (empty.places, int(empty.correct.sum())) == (0, 0)
    np.testing.assert_array_equal(empty.positive, whole.positive)


def test_the_places_around_a_scan_of_the_same_drive_are_left_out(embedded_street: Street) -> None:
    drive = embedded_street(0, 40)
    pair = Pair('m', 'g', 'street', 0, 0, 4.0)
    own = search_drive_map(pair, drive, drive, Rules())
    assert own.correct.all()
    assert (own.errors_m == 0.0).all()
    # Scans are 1 s and 4 m apart: no place more than 6 s away is within 25 m.
    without = search_drive_map(pair, drive, drive, Rules(exclusion_ns=5 * 10**9))
    assert (np.abs(without.found - np.arange(40)) > 5).all()
    assert (without.errors_m >= 24.0).all()
    assert without.positive.all()
    assert not search_drive_map(pair, drive, drive, Rules(exclusion_ns=6 * 10**9)).positive.any()


def test_pairs_of_a_search_against_a_loop(embedded_street: Street) -> None:
    mapped, query = embedded_street(0, 40), embedded_street(1, 30)
    level = search_drive_map(Pair('m', 'g', 'street', 0, 1, 12.0), mapped, query, Rules(25.0, 50.0)).pair_level
    assert level is not None
    found = []
    for scan in range(30):
        for row in map_rows(mapped, 12.0):
            apart_m = float(np.hypot(*(mapped.drive.poses[row] - query.drive.poses[scan])[:2]))
            if apart_m <= 25.0 or apart_m > 50.0:
                found.append((float(np.linalg.norm(mapped.means[row] - query.means[scan])), apart_m <= 25.0))
    hits, area, relevant = 0, 0.0, sum(positive for _, positive in found)
    for accepted, (_, positive) in enumerate(sorted(found), start=1):
        hits += positive
        area += positive / relevant * hits / accepted
    assert level.average_precision == pytest.approx(area, abs=1e-6)
    assert level.precisions[-1] == pytest.approx(relevant / max(k for k, (_, r) in enumerate(sorted(found), 1) if r))
    assert (np.diff(level.precisions) <= 0.0).all()
