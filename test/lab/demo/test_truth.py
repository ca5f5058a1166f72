"""The demonstration compares answers with the recorded positions, and shows the comparison."""

from __future__ import annotations

import dataclasses
import io
import math
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console
from street_sequence import ORIGIN

from offradar_ros.lab.demo.drives import DemoDrive
from offradar_ros.lab.demo.live import ReplayedDrive
from offradar_ros.lab.demo.picture import REJECTED_OFF, REJECTED_RIGHT, REJECTED_WRONG, RIGHT, WRONG, draw_map
from offradar_ros.lab.demo.report import print_table, what_rejection_saves
from offradar_ros.lab.demo.truth import ComparedDrive, compare
from offradar_ros.mapping.stored_map import StoredSession
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.types import (
    Candidate,
    Localisation,
    LocalisationState,
    Match,
    Outcome,
    Place,
    PlaceTable,
    Pose,
    Reason,
    Rejection,
)


def answer(stamp_ns: int, x_m: float | None, reason: Reason | None = None, uncertainty: float = 1.0) -> Outcome:
    candidates = () if x_m is None else (Candidate(1, 0.5, 1.0, Pose(x_m, 0.0)),)
    if reason is None:
        return Match(stamp_ns, uncertainty, 1.1, candidates, 0.97)
    return Rejection(stamp_ns, reason, uncertainty, 1.1, candidates, 'for the test', 0.2)


def place(x_m: float) -> Place:
    return Place(1, 1, 0, Pose(x_m, 0.0), 0.9, np.zeros(4, np.float32))


def localisation(stamp_ns: int, state: LocalisationState) -> Localisation:
    p_on_map = 0.04 if state is LocalisationState.OFF_MAP else 0.96
    return Localisation(stamp_ns, state, p_on_map, 1, p_on_map, np.zeros(2), np.eye(2))


@pytest.fixture
def compared(street_bag: Callable[..., Path]) -> ComparedDrive:
    """Eight scans, 1.25 m apart, in a map of two places: 24.5 m behind the fourth, and far away.

    Four are on the map: matched right, matched wrong, rejected right at a high U, rejected wrong. Four are off it:
    matched, rejected at a low U, rejected at a high U, rejected without candidates and without a localisation.
    """
    bag = street_bag('drive', count=8)
    stamps = [int(stamp) for stamp in BagSequence(bag).stamps_ns]
    near = 3 * 1.25 - 24.5
    outcomes = (
        answer(stamps[0], near),
        answer(stamps[1], 500.0),
        answer(stamps[2], near, Reason.UNCERTAIN, 2.0),
        answer(stamps[3], 500.0, Reason.AMBIGUOUS),
        answer(stamps[4], near),
        answer(stamps[5], near, Reason.UNKNOWN_PLACE),
        answer(stamps[6], 500.0, Reason.UNCERTAIN, 2.0),
        answer(stamps[7], None, Reason.INVALID_EMBEDDING, math.nan),
    )
    drive = DemoDrive('drive', bag, mapped=True, degraded_ns=frozenset(stamps[2:4]))
    counts = {'scans': 8, 'matches': 3, 'rejections': 5, 'unanswered': 0}
    places = PlaceTable.from_places([place(near), place(500.0)], 4)
    states = [LocalisationState.UNSURE, *3 * [LocalisationState.ON_MAP], *3 * [LocalisationState.OFF_MAP]]
    found = {stamp: localisation(stamp, state) for stamp, state in zip(stamps, states, strict=False)}
    return compare(ReplayedDrive(drive, places, outcomes, found, counts, (0.01, 0.02, 0.03), ''), ORIGIN)


def test_an_answer_is_right_within_25_metres(compared: ComparedDrive) -> None:
    np.testing.assert_allclose(compared.positions_m[:, 0], 1.25 * np.arange(8), atol=1e-3)
    assert compared.nearest_is_right.tolist() == [True, False, True, False] + 4 * [False]
    assert compared.accepted.tolist() == [True, True, False, False, True, False, False, False]
    assert compared.degraded.tolist() == [False, False, True, True] + 4 * [False]
    np.testing.assert_array_equal(compared.p_right, [0.97, 0.97, 0.2, 0.2, 0.97, 0.2, 0.2, 0.2])


def test_a_scan_is_off_the_map_without_a_place_within_25_metres(compared: ComparedDrive) -> None:
    assert compared.on_map.tolist() == 4 * [True] + 4 * [False]
    assert compared.off_map.tolist() == 4 * [False] + 4 * [True]
    empty = dataclasses.replace(compared.replayed, places=PlaceTable.from_places([], 4))
    unmapped = compare(empty, ORIGIN)
    assert not unmapped.on_map.any()
    assert not unmapped.off_map.any()


def test_the_rule_of_the_paper_asks_for_a_low_uncertainty_alone(compared: ComparedDrive) -> None:
    assert compared.paper_accepts.tolist() == [True, True, False, True, True, True, False, False]


def test_the_belief_is_that_of_the_scan(compared: ComparedDrive) -> None:
    assert compared.states.tolist() == ['unsure', *3 * ['on_map'], *3 * ['off_map'], '']
    np.testing.assert_array_equal(compared.p_on_map, [*4 * [0.96], *3 * [0.04], np.nan])


def test_the_table_shows_the_comparison(compared: ComparedDrive) -> None:
    console = Console(file=io.StringIO(), width=100)
    report = {'inserted': 2, 'replaced': 1, 'kept': 3, 'places_before': 0, 'places_after': 2}
    means = {'mean_uncertainty_before': None, 'mean_uncertainty_after': 0.98765}
    print_table([compared], [StoredSession(1, 'drive', 0, 'ended', report | means)], console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    rows = [
        'matches .* 3 ',
        'rejected: uncertain .* 2 ',
        'on the map: a place within 25 m',
        r'Recall@1, .* 0\.500 of 4',
        'matches, right / wrong .* 1 / 1 ',
        'rejected, would be right / wrong .* 1 / 1 ',
        'rejected, degraded / clean .* 2 / 0 ',
        'off the map',
        'matches, each wrong .* 1 of 4 ',
        'rejected: invalid_embedding .* 1 ',
        'rejected: uncertain .* 1 ',
        'rejected: unknown_place .* 1 ',
        'matches on the map, right / wrong .* 1 / 2 ',
        'matches off the map, each wrong .* 2 of 4 ',
        'on_map, scans on / off the map .* 3 / 0 ',
        'off_map, scans on / off the map .* 0 / 3 ',
        'unsure, scans on / off the map .* 1 / 0 ',
        'inserted, replaced, kept .* 2, 1, 3',
        'mean U .* - → 0.988',
    ]
    assert re.search('.*'.join(rows), printed, re.DOTALL)


def test_a_drive_without_a_map_has_no_recall(compared: ComparedDrive) -> None:
    drive = dataclasses.replace(compared.replayed.drive, mapped=False)
    empty = dataclasses.replace(compared.replayed, drive=drive, places=PlaceTable.from_places([], 4))
    console = Console(file=io.StringIO(), width=100)
    print_table([compare(empty, ORIGIN)], [], console)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    assert re.search(r'Recall@1, if all were answered +│ - +│', printed)
    assert re.search(r'matches, each wrong +│ - +│', printed)
    assert ' nan' not in printed


def test_the_sentence_compares_both_gates_off_the_map(compared: ComparedDrive) -> None:
    sentence = what_rejection_saves(compared)
    assert sentence.startswith('4 scans of drive are off the map')
    assert ' 1 were answered' in sentence
    assert sentence.endswith('would have answered 2.')


def test_the_picture_is_drawn(compared: ComparedDrive, tmp_path: Path) -> None:
    draw_map(compared, compared, 0.9, tmp_path / 'map.png')
    picture = cv2.imread(str(tmp_path / 'map.png'))
    assert picture is not None
    assert picture.shape[0] > 400
    for style in (RIGHT, WRONG, REJECTED_RIGHT, REJECTED_WRONG, REJECTED_OFF):
        rgb = [int(style.colour[i : i + 2], 16) for i in (1, 3, 5)]
        assert np.all(picture == rgb[::-1], axis=-1).any(), style.label
