"""The nearest places of queries are aligned with them, and the errors are those of the poses."""

from __future__ import annotations

import numpy as np
from street_sequence import StreetSequence

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.aligned import aligned_answers, joined_answers
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive

COUNT = 16
TOLERANCE_M = 3.0


def drive(lane_m: float, *, backwards: bool = False) -> EmbeddedDrive:
    """A drive eastwards whose descriptors are its positions; or the same, with truth that looks to the west."""
    street = StreetSequence(count=COUNT, lane_m=lane_m, noise_seed=round(10 * lane_m))
    along_m = 1.25 * np.arange(COUNT, dtype=np.float64)
    poses = np.column_stack([along_m, np.full(COUNT, lane_m), np.full(COUNT, np.pi if backwards else 0.0)])
    made = Drive(
        name=f'lane {lane_m:g}',
        world='street',
        key=f'{lane_m:g}',
        stamps_ns=street.stamps_ns,
        poses=poses,
        driven_m=along_m,
        kinds=np.full(COUNT, ''),
        severities=np.zeros(COUNT),
        read_scan=street.scan,
    )
    means = np.column_stack([along_m, np.zeros(COUNT)]).astype(np.float32)
    return EmbeddedDrive(made, means, np.ones(COUNT))


def test_places_are_aligned_where_the_truth_has_them() -> None:
    drives = [drive(0.0), drive(1.0)]
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
    drives = [drive(0.0, backwards=True), drive(1.0)]
    made, *_ = aligned_answers(drives, 2.5, TOLERANCE_M, places=2, queries=0, seed=1, whole=True)
    assert len(made) == COUNT
    np.testing.assert_allclose(np.abs(made.truths[..., 2]), np.pi)
    np.testing.assert_allclose(np.abs(made.errors[..., 2]), np.pi, atol=0.02)
