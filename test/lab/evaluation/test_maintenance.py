"""The ablation O, M, M_random, Q, QM against plain loops."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.lab.evaluation.ablation_summary import summarise_ablation
from offradar_ros.lab.evaluation.answers import Pair, Rules, map_rows, places_of, search_drive_map, search_places
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.maintenance import Ablation, ablate, merge_plans
from offradar_ros.lab.evaluation.protocol import Maintenance, Protocol

PLAN = Maintenance(match_distance_m=5.0, random_repeats=3)
PAIR = Pair('m', 'g', 'street', 0, 2, 12.0)


@pytest.fixture(scope='module')
def drives(embedded_street: Callable[..., EmbeddedDrive]) -> list[EmbeddedDrive]:
    return [embedded_street(index, 90) for index in range(3)]


def ablated(drives: list[EmbeddedDrive]) -> Ablation:
    first, second, query = drives
    unmaintained = search_drive_map(PAIR, first, query, Rules())
    return ablate(unmaintained, first, [second], query, PLAN, Rules(), seed=1)


@pytest.fixture(scope='module')
def ablation(drives: list[EmbeddedDrive]) -> Ablation:
    return ablated(drives)


def test_every_ordered_pair_has_the_others_merged(drives: list[EmbeddedDrive]) -> None:
    plans = [(m.drive.index, [d.drive.index for d in between], q.drive.index) for m, between, q in merge_plans(drives)]
    assert plans == [(0, [2], 1), (0, [1], 2), (1, [2], 0), (1, [0], 2), (2, [1], 0), (2, [0], 1)]
    assert not list(merge_plans(drives[:2]))


def test_a_drive_that_is_only_searched_for_is_never_merged(drives: list[EmbeddedDrive]) -> None:
    query_only = [dataclasses.replace(d, drive=dataclasses.replace(d.drive, mapped=False)) for d in drives[2:]]
    map_only = [dataclasses.replace(d, drive=dataclasses.replace(d.drive, queried=False)) for d in drives[:2]]
    plans = [
        (m.drive.index, [d.drive.index for d in between], q.drive.index)
        for m, between, q in merge_plans(map_only + query_only)
    ]
    assert plans == [(0, [1], 2), (1, [0], 2)]


def test_the_maintained_map_against_a_loop(drives: list[EmbeddedDrive], ablation: Ablation) -> None:
    first, second, query = drives
    places = [(first, int(row)) for row in map_rows(first, 12.0)]
    anchors = [drive.drive.poses[row, :2] for drive, row in places]
    replaced = opportunities = 0
    for row in range(90):
        distances = [float(np.hypot(*(anchor - second.drive.poses[row, :2]))) for anchor in anchors]
        best = int(np.argmin(distances))
        if distances[best] < 5.0:
            opportunities += 1
            drive, at = places[best]
            if second.uncertainties[row] < drive.uncertainties[at]:
                places[best] = (second, row)
                replaced += 1
    rows = np.array([row for _, row in places])
    table = dataclasses.replace(
        places_of(first, rows),
        means=np.array([drive.means[row] for drive, row in places]),
        positions_m=np.array([[*drive.drive.poses[row, :2], 0.0] for drive, row in places]),
    )
    expected = search_places(PAIR, table, query, Rules())
    before = np.column_stack([anchors, first.uncertainties[map_rows(first, 12.0)]])
    np.testing.assert_allclose(ablation.before, before, rtol=1e-6)
    held = [[*drive.drive.poses[row, :2], drive.uncertainties[row]] for drive, row in places]
    np.testing.assert_allclose(ablation.after, held, rtol=1e-6)
    assert (ablation.opportunities, ablation.replaced) == (opportunities, replaced)
    assert 0 < replaced < opportunities
    np.testing.assert_array_equal(ablation.maintained.ranks, expected.ranks)


def test_all_maps_are_of_one_size_and_maintenance_helps(ablation: Ablation, small_protocol: Protocol) -> None:
    sizes = {a.places for a in (ablation.unmaintained, ablation.maintained, *ablation.random)}
    assert sizes == {30}
    assert len(ablation.random) == 3
    figures = summarise_ablation([ablation], 0.6, small_protocol)
    recall = figures.recall_at_1
    assert recall['M'] > recall['O']
    assert recall['M'] > recall['M_random']
    assert recall['QM'] > recall['Q']
    assert 0.1 < figures.rejected < 0.5
    assert figures.gain_over_unmaintained.value == pytest.approx(recall['M'] - recall['O'])
    assert figures.gain_over_random.value == pytest.approx(recall['M'] - recall['M_random'])
    # A single pair has no interval.
    assert math.isnan(figures.gain_over_unmaintained.low)
    several = summarise_ablation([ablation] * 3, math.nan, small_protocol)
    assert several.gain_over_unmaintained.low == pytest.approx(recall['M'] - recall['O'])
    assert math.isnan(several.recall_at_1['Q'])
    assert math.isnan(several.rejected)


def test_the_control_makes_as_many_replacements(drives: list[EmbeddedDrive]) -> None:
    first, second, query = drives
    worse = dataclasses.replace(second, uncertainties=second.uncertainties + 100.0)
    unmaintained = search_drive_map(PAIR, first, query, Rules())
    nothing = ablate(unmaintained, first, [worse], query, PLAN, Rules(), seed=1)
    # No merged scan is more certain than the scan of its place: the control replaces nothing either.
    assert nothing.replaced == 0 < nothing.opportunities
    for control in (nothing.maintained, *nothing.random):
        np.testing.assert_array_equal(control.distances, unmaintained.distances)
    better = dataclasses.replace(second, uncertainties=np.linspace(0.02, 0.01, 90))
    whole = ablate(unmaintained, first, [better], query, PLAN, Rules(), seed=1)
    # Every merged scan is more certain than the one before: all of them replace, in the control too, in the same order.
    assert whole.replaced == whole.opportunities > 0
    for control in whole.random:
        np.testing.assert_array_equal(control.distances, whole.maintained.distances)


def test_the_draws_of_the_control_differ_and_follow_the_seed(drives: list[EmbeddedDrive], ablation: Ablation) -> None:
    again = ablated(drives)
    for a, b in zip(again.random, ablation.random, strict=True):
        np.testing.assert_array_equal(a.distances, b.distances)
    assert len({tuple(a.distances.tolist()) for a in ablation.random}) > 1


def test_only_certain_queries_are_answered(ablation: Ablation, small_protocol: Protocol) -> None:
    recall = summarise_ablation([ablation], 0.5, small_protocol).recall_at_1
    chosen = ablation.unmaintained.positive & (ablation.unmaintained.uncertainties <= 0.5)
    assert recall['Q'] == pytest.approx(np.mean(ablation.unmaintained.correct[chosen]))
    assert recall['QM'] == pytest.approx(np.mean(ablation.maintained.correct[chosen]))
    assert np.isnan(summarise_ablation([ablation], -1.0, small_protocol).recall_at_1['Q'])
