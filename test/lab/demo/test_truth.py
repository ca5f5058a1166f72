"""The demonstration compares answers with the recorded positions, and shows the comparison."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from offradar_ros.lab.demo.drives import DemoDrive
from offradar_ros.lab.demo.live import ReplayedDrive
from offradar_ros.lab.demo.report import draw_map, print_table
from offradar_ros.lab.demo.truth import ComparedDrive, compare
from offradar_ros.mapping.stored_map import StoredSession
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.types import Candidate, Match, Outcome, Place, PlaceTable, Pose, Reason, Rejection


def answer(stamp_ns: int, x_m: float | None, reason: Reason | None = None) -> Outcome:
    candidates = () if x_m is None else (Candidate(1, 0.5, 1.0, Pose(x_m, 0.0)),)
    if reason is None:
        return Match(stamp_ns, 1.0, 1.1, candidates)
    return Rejection(stamp_ns, reason, 2.0, 1.1, candidates, 'for the test')


@pytest.fixture
def compared(street_bag: Callable[..., Path]) -> ComparedDrive:
    """Six scans, 1.25 m apart: matched right, matched 26 m off, rejected right, rejected wrong, map empty, right."""
    bag = street_bag('drive', count=6)
    sequence = BagSequence(bag)
    stamps = [int(stamp) for stamp in sequence.stamps_ns]
    outcomes = (
        answer(stamps[0], 24.0),
        answer(stamps[1], 1.25 + 26.0),
        answer(stamps[2], 2.5, Reason.UNCERTAIN),
        answer(stamps[3], 500.0, Reason.UNCERTAIN),
        answer(stamps[4], None, Reason.MAP_EMPTY),
        answer(stamps[5], 6.25),
    )
    drive = DemoDrive('drive', bag, mapped=True, degraded_ns=frozenset(stamps[2:4]))
    counts = {'scans': 6, 'matches': 3, 'rejections': 3, 'unanswered': 0}
    origin = sequence.trajectory.origin()  # type: ignore[union-attr]
    assert origin is not None
    return compare(ReplayedDrive(drive, outcomes, counts, (0.01, 0.02, 0.03), ''), origin)


def test_an_answer_is_right_within_25_metres(compared: ComparedDrive) -> None:
    # The first fix, the origin, lies 1 s before the first scan: 5 m behind it.
    np.testing.assert_allclose(compared.positions_m[:, 0], 5.0 + 1.25 * np.arange(6), atol=1e-3)
    assert compared.nearest_is_right.tolist() == [True, True, True, False, False, True]
    assert compared.accepted.tolist() == [True, True, False, False, False, True]
    assert compared.degraded.tolist() == [False, False, True, True, False, False]
    assert compared.recall(compared.accepted) == 1.0
    assert compared.recall(~compared.accepted) == pytest.approx(1 / 3)
    assert np.isnan(compared.recall(np.zeros(6, np.bool_)))


def test_the_table_shows_the_comparison(compared: ComparedDrive) -> None:
    console = Console(file=io.StringIO(), width=100)
    report = {'inserted': 2, 'replaced': 1, 'kept': 3, 'places_before': 0, 'places_after': 2}
    means = {'mean_uncertainty_before': None, 'mean_uncertainty_after': 0.98765}
    print_table([compared], [StoredSession(1, 'drive', 0, 'ended', report | means)], console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    for row in (
        'matches .* 3 ',
        'rejected: map_empty .* 1 ',
        'rejected: uncertain .* 2 ',
        'rejected with a map, degraded / clean .* 2 / 0 ',
        'Recall@1 of the matches .* 1.000 of 3',
        'inserted, replaced, kept .* 2, 1, 3',
        'mean U .* - → 0.988',
    ):
        assert any(re.search(row, line) for line in printed.splitlines()), row


def test_the_picture_is_drawn(compared: ComparedDrive, tmp_path: Path) -> None:
    places = PlaceTable.from_places([Place(1, 1, 0, Pose(5.0, 0.0), 0.9, np.zeros(4, np.float32))], 4)
    draw_map(places, compared, tmp_path / 'map.png')
    picture = cv2.imread(str(tmp_path / 'map.png'))
    assert picture is not None
    assert picture.shape[0] > 400
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
