"""The nearest places of queries are aligned with them, and the errors are those of the poses."""

from __future__ import annotations

import dataclasses

import numpy as np
from driven_street import COUNT, driven_street, with_refused_scans

from offradar_ros.errors import RefusedInput
from offradar_ros.lab.evaluation.aligned import aligned_answers, joined_answers

TOLERANCE_M = 3.0


def test_places_are_aligned_where_the_truth_has_them() -> None:
    drives = [driven_street(0.0), driven_street(1.0)]
    made = list(aligned_answers(drives, 2.5, TOLERANCE_M, places=2, queries=4, seed=1))
    # Either drive in either half of the other one.
    assert [len(one) for one in made] == [4] * 4
    answers = joined_answers(made)
    assert answers.scores.shape == (16, 2)
    near = answers.away_m <= TOLERANCE_M
    assert near.any()
    assert (near.any(axis=1) == answers.on_map).all()
    assert not answers.on_map.all()
    assert np.abs(answers.errors[near][:, :2]).max() < 0.4
    assert np.degrees(np.abs(answers.errors[near][:, 2])).max() < 1.0
    assert (np.linalg.eigvalsh(answers.covariances[near]) > 0.0).all()
    np.testing.assert_allclose(answers.truths[..., 2], 0.0, atol=1e-9)
    # The evidence of each place is for that place.
    distances = answers.evidence.distance.reshape(16, 2)
    assert (np.diff(distances, axis=1) >= 0.0).all()


def test_the_truth_is_seen_from_the_place() -> None:
    """As if the mapped vehicle had been turned round, of which its scans know nothing."""
    drives = [driven_street(0.0, backwards=True), driven_street(1.0)]
    made, *_ = aligned_answers(drives, 2.5, TOLERANCE_M, places=2, queries=0, seed=1, whole=True)
    assert len(made) == COUNT
    np.testing.assert_allclose(np.abs(made.truths[..., 2]), np.pi)
    np.testing.assert_allclose(np.abs(made.errors[..., 2]), np.pi, atol=0.02)


def test_the_rows_of_queries_and_places_are_named() -> None:
    """Descriptors are positions here, so that the nearest places are known."""
    drives = [driven_street(0.0), driven_street(1.0)]
    made, *_ = aligned_answers(drives, 2.5, TOLERANCE_M, places=2, queries=0, seed=1, whole=True)
    np.testing.assert_array_equal(made.query_rows, np.arange(COUNT))
    assert set(made.place_rows.ravel().tolist()) <= set(range(0, COUNT, 2))
    assert (np.abs(made.place_rows[:, 0] - made.query_rows) <= 1).all()
    np.testing.assert_allclose(made.truths[..., 0], 1.25 * (made.query_rows[:, None] - made.place_rows))
    np.testing.assert_allclose(np.abs(made.truths[..., 1]), 1.0)


def test_farther_places_of_the_ten_nearest_count_without_being_aligned() -> None:
    """Descriptors put the mapped drive half a street, seven places, away from where it is."""
    mapped, query = driven_street(0.0), driven_street(1.0)
    shift = np.array([8.75, 0.0], np.float32)
    drives = [dataclasses.replace(mapped, means=mapped.means + shift), query]
    made, *_ = aligned_answers(drives, 1.25, TOLERANCE_M, places=2, queries=0, seed=1, whole=True)
    ordered = np.argsort(np.abs(drives[0].means[None, :, 0] - query.means[:, None, 0]), axis=1, kind='stable')
    offsets_m = np.hypot(1.25 * (ordered - np.arange(COUNT)[:, None]), 1.0)
    np.testing.assert_array_equal(made.in_ten, (offsets_m[:, :10] <= TOLERANCE_M).any(axis=1))
    assert made.scores.shape == (COUNT, 2)
    assert (made.in_ten & (made.away_m > TOLERANCE_M).all(axis=1)).any()
    assert not made.in_ten.all()
    assert made.on_map.all()


def test_a_scan_that_cannot_be_read_is_aligned_with_nothing() -> None:
    gone = RefusedInput('unreadable', 'scan 4: cannot be read')
    drives = [driven_street(0.0), with_refused_scans(driven_street(1.0), {4}, gone)]
    made, back = aligned_answers(drives, 2.5, TOLERANCE_M, places=2, queries=0, seed=1, whole=True)
    assert np.isnan(made.scores[4]).all()
    assert np.isnan(made.errors[4]).all()
    others = np.arange(COUNT) != 4
    assert np.isfinite(made.scores[others]).all()
    assert len(made) == COUNT
    # As a place, too.
    np.testing.assert_array_equal(np.isnan(back.scores), back.place_rows == 4)
    assert (back.place_rows == 4).any()
