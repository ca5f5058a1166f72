"""Stamps of rows: the unit, wrong ones among right ones, and clocks that nobody set."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from offradar_ros.radar.row_stamps import RowStamps, sound_stamps

START_NS = 1_567_410_201_563_630_080
STEP_NS = 625_000
TRUE_NS = START_NS + STEP_NS * np.arange(400, dtype=np.int64)


def found(stamps: np.ndarray, scan_ns: int | None = None) -> RowStamps:
    return sound_stamps(stamps.astype(np.int64), np.ones(len(stamps), np.bool_), scan_ns)


def test_stamps_in_order_are_returned_to_the_nanosecond() -> None:
    stamps = found(TRUE_NS).stamps_ns
    assert stamps is not None
    assert np.array_equal(stamps, TRUE_NS)


def test_equal_stamps_are_kept() -> None:
    stamps = found(np.full(400, START_NS))
    assert stamps.mended == 0
    assert stamps.stamps_ns is not None
    assert set(stamps.stamps_ns.tolist()) == {START_NS}


WRONG: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    'another year': lambda at: TRUE_NS[at] + 365 * 86_400 * 10**9,
    'zero': lambda at: 0 * at,
    'the largest number': lambda at: 0 * at + (2**63 - 1),
    'the smallest number': lambda at: 0 * at - 2**62,
    'a tenth of a second ahead': lambda at: TRUE_NS[at] + 10**8,
    'a tenth of a second back': lambda at: TRUE_NS[at] - 10**8,
}


@pytest.mark.parametrize('kind', WRONG)
@given(wrong=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_wrong_stamps_are_interpolated(kind: str, wrong: int, seed: int) -> None:
    at = np.sort(1 + np.random.default_rng(seed).permutation(398)[:wrong])
    stamps = TRUE_NS.copy()
    stamps[at] = WRONG[kind](at)
    mended = found(stamps)
    assert mended.mended <= wrong + 1
    assert mended.stamps_ns is not None
    # A few rows at an end have no neighbour beyond them: one that is a little off may be taken for right.
    limit_ns = 10**8 + 5 * STEP_NS if 'tenth' in kind else STEP_NS
    assert np.abs(mended.stamps_ns - TRUE_NS).max() <= limit_ns + 1


def test_a_single_wrong_stamp_moves_no_other() -> None:
    stamps = TRUE_NS.copy()
    stamps[123] += 365 * 86_400 * 10**9
    mended = found(stamps)
    assert mended.mended == 1
    assert mended.stamps_ns is not None
    assert np.abs(mended.stamps_ns - TRUE_NS).max() <= 1


def test_rows_out_of_order_are_mended() -> None:
    stamps = TRUE_NS.copy()
    stamps[[10, 11, 200, 201]] = stamps[[11, 10, 201, 200]]
    mended = found(stamps)
    assert mended.mended == 2
    assert mended.stamps_ns is not None
    assert np.all(np.diff(mended.stamps_ns) >= 0)


def test_stamps_that_contradict_each_other_are_not_used() -> None:
    stamps = TRUE_NS.copy()
    stamps[::3] += 365 * 86_400 * 10**9
    assert found(stamps).stamps_ns is None
    assert found(TRUE_NS[::-1].copy()).stamps_ns is None
    assert found(TRUE_NS + np.where(np.arange(400) < 200, 0, 3600 * 10**9)).stamps_ns is None


@pytest.mark.parametrize('stamps', [np.zeros(400), 900 * 10**6 + 625 * np.arange(400), np.full(400, -1)])
def test_a_clock_that_was_never_set_gives_no_stamps(stamps: np.ndarray) -> None:
    assert found(stamps).stamps_ns is None
    assert found(stamps, START_NS).stamps_ns is None


def test_stamps_of_a_simulated_clock_are_told_by_that_of_the_scan() -> None:
    stamps = 900 * 10**9 + STEP_NS * np.arange(400)
    assert found(stamps).stamps_ns is None
    for stored in (stamps, stamps // 1000):
        told = found(stored, 900 * 10**9 + 10**8).stamps_ns
        assert told is not None
        assert told.tolist() == stamps.tolist()


def test_stamps_after_the_year_2100_are_of_no_clock() -> None:
    assert found(4_102_444_800 * 10**9 + STEP_NS * np.arange(400)).stamps_ns is None


def test_a_coarse_clock_is_right() -> None:
    stamps = START_NS + 500_000 * (np.arange(400) >= 250)
    told = found(stamps).stamps_ns
    assert told is not None
    assert told.tolist() == stamps.tolist()
    stamps = np.repeat(TRUE_NS[:200], 2)
    stamps[123] += 10 * STEP_NS
    assert found(stamps).mended == 1


def test_of_a_few_rows_one_may_be_wrong() -> None:
    stamps = TRUE_NS[:8].copy()
    stamps[3] = 0
    assert found(stamps).mended == 1
    stamps[5] = 0
    assert found(stamps).stamps_ns is None
    one = found(TRUE_NS[:1]).stamps_ns
    assert one is not None
    assert one.tolist() == [START_NS]


def test_rows_that_were_measured_without_a_stamp_are_wrong_ones() -> None:
    written = np.ones(400, np.bool_)
    written[100:150] = False
    assert sound_stamps(TRUE_NS, written, None).mended == 0
    assert sound_stamps(TRUE_NS, written, None, lost=35).mended == 35
    assert sound_stamps(TRUE_NS, written, None, lost=50).stamps_ns is None
    assert sound_stamps(TRUE_NS, np.zeros(400, np.bool_), None).stamps_ns is None


@given(stamps=st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=40), scan=st.integers(0, 2**62))
@example(stamps=[1, -(2**63)], scan=0)
@settings(max_examples=200, deadline=None)
def test_any_stamps_give_as_many_in_order_or_none(stamps: list[int], scan: int) -> None:
    result = found(np.array(stamps, np.int64), scan).stamps_ns
    assert result is None or (len(result) == len(stamps) and bool(np.all(np.diff(result) >= 0)))
