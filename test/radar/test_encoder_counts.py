"""Angles are right to a count, whatever happens to a few rows, and a scan is refused where most rows do not say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.errors import RefusedInput
from offradar_ros.radar.encoder_counts import LARGEST_SHARE_MENDED, RowAngles, angles_of_counts, full_turn_counts

ROWS = 400
TURN = 2 * np.pi


def angles(counts: np.ndarray, size: int = 5600, samples: int = ROWS) -> RowAngles:
    return angles_of_counts(counts.astype(np.int64), np.ones(len(counts), np.bool_), size, samples)


def error_rad(found: np.ndarray, counts: np.ndarray, size: int) -> float:
    """Largest angle between found and true azimuths."""
    apart = np.mod(found - counts * TURN / size + np.pi, TURN) - np.pi
    return float(np.abs(apart).max())


def cause_of(counts: np.ndarray, size: int = 5600, samples: int = ROWS) -> str:
    with pytest.raises(RefusedInput) as refused:
        angles(counts, size, samples)
    assert '\n' not in str(refused.value)
    return refused.value.cause


@pytest.mark.parametrize('size', [5600, 16000, 65536])
@pytest.mark.parametrize('first', [0, 1, 7, 2000])
def test_the_step_of_the_rows_tells_the_size_of_a_turn(size: int, first: int) -> None:
    counts = first + np.rint(size / ROWS * np.arange(ROWS)).astype(int)
    found = angles(np.mod(counts, size))
    assert found.mended == 0
    assert error_rad(found.angles_rad, counts, size) < 1e-9


@pytest.mark.parametrize('counts', [14 * np.arange(1, 401), 14 * np.arange(400), 5 + 14 * np.arange(400)])
def test_a_full_turn_is_zero(counts: np.ndarray) -> None:
    found = angles(counts)
    assert found.mended == 0
    assert error_rad(found.angles_rad, counts, 5600) < 1e-9
    assert np.all((found.angles_rad >= 0) & (found.angles_rad < TURN))


def test_counts_that_go_on_after_a_turn_are_the_same_angles() -> None:
    counts = 2800 + 14 * np.arange(ROWS)
    assert angles(counts).angles_rad == pytest.approx(angles(np.mod(counts, 5600)).angles_rad)


@pytest.mark.parametrize('step', [10, 20, 7, 3, 100])
def test_a_turn_of_an_unknown_size_is_refused_unless_it_is_configured(step: int) -> None:
    counts = np.mod(step * np.arange(ROWS), 65536)
    assert cause_of(counts) == 'unknown_turn'
    found = angles(counts, size=step * ROWS)
    assert error_rad(found.angles_rad, counts, step * ROWS) < 1e-9


def test_a_part_of_a_turn_is_read_where_the_step_tells_the_turn() -> None:
    for rows in (5, 60, 399):
        counts = 14 * np.arange(rows)
        assert error_rad(angles(counts).angles_rad, counts, 5600) < 1e-9
    assert cause_of(16 * np.arange(500), 16000, samples=400) == 'unknown_turn'
    counts = 16 * np.arange(500)
    assert error_rad(angles(counts, 16000, samples=1000).angles_rad, counts, 16000) < 1e-9


def test_known_sizes_come_after_the_configured_one() -> None:
    assert full_turn_counts(14.0, 400, 5600, 400) == 5600
    assert full_turn_counts(40.0, 400, 5600, 400) == 16000
    assert full_turn_counts(20.0, 400, 8000, 400) == 8000
    assert full_turn_counts(20.0, 400, 5600, 400) is None
    assert full_turn_counts(14.0, 4681, 5600, 400) == 65536
    assert full_turn_counts(14.0, 500, 5600, 400) == 5600
    assert full_turn_counts(14.0, 501, 5600, 400) is None


CORRUPTIONS = {
    'a full turn too large': lambda counts, at, random: counts[at] + 5600,
    'zero': lambda counts, at, random: 0 * counts[at],
    'the largest number': lambda counts, at, random: 0 * counts[at] + 65535,
    'any number': lambda counts, at, random: random.integers(0, 65536, len(at)),
    'as the row before': lambda counts, at, random: counts[at - 1],
    'as the row after': lambda counts, at, random: counts[np.minimum(at + 1, len(counts) - 1)],
    'a quarter of a turn ahead': lambda counts, at, random: np.mod(counts[at] + 1400, 5600),
    'a little back': lambda counts, at, random: np.maximum(counts[at] - 42, 0),
}


@pytest.mark.parametrize('kind', CORRUPTIONS)
@given(
    first=st.integers(0, 5599),
    wrong=st.integers(1, int(LARGEST_SHARE_MENDED * ROWS)),
    seed=st.integers(0, 2**32 - 1),
    together=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_angles_are_right_to_a_step_whatever_happens_to_a_tenth_of_the_rows(
    kind: str, first: int, wrong: int, seed: int, together: bool
) -> None:
    """A wrong row lies between its neighbours, so its angle is right; only an end may be a step off."""
    random = np.random.default_rng(seed)
    true = np.mod(first + 14 * np.arange(ROWS), 5600)
    at = random.integers(0, ROWS - wrong + 1) + np.arange(wrong) if together else random.permutation(ROWS)[:wrong]
    counts = true.copy()
    counts[at] = CORRUPTIONS[kind](true, at, random)
    found = angles(counts)
    assert found.mended <= wrong + 1
    # Rows at an end that are as little off, by chance too, look like rows after a gap.
    off = np.abs(np.mod(counts[at] - true[at] + 2800, 5600) - 2800)
    limit = 42 if np.any((off > 0) & (off <= 42)) else 14
    assert error_rad(found.angles_rad, true, 5600) <= limit * TURN / 5600 + 1e-9


def test_more_wrong_rows_than_a_tenth_are_refused() -> None:
    random = np.random.default_rng(0)
    counts = 7 + 14 * np.arange(ROWS)
    at = random.permutation(ROWS)
    counts[at[:40]] = random.integers(0, 65536, 40)
    assert angles(counts).mended <= 40
    counts[at[:70]] = random.integers(0, 65536, 70)
    assert cause_of(counts) == 'unsound_rows'


def test_of_a_few_rows_one_may_be_wrong() -> None:
    counts = 14 * np.arange(8)
    counts[3] = 5000
    assert angles(counts).mended == 1
    counts[5] = 4000
    assert cause_of(counts) == 'unsound_rows'
    assert cause_of(14 * np.arange(3)) == 'no_row_angles'


def test_rows_that_were_measured_without_a_count_are_wrong_ones() -> None:
    counts, written = 14 * np.arange(ROWS), np.ones(ROWS, np.bool_)
    written[100:150] = False
    found = angles_of_counts(counts, written, 5600, ROWS)
    assert found.mended == 0
    assert angles_of_counts(counts, written, 5600, ROWS, lost=35).mended == 35
    with pytest.raises(RefusedInput, match='encoder counts of 50 of 400 rows contradict the others') as refused:
        angles_of_counts(counts, written, 5600, ROWS, lost=50)
    assert refused.value.cause == 'unsound_rows'


@pytest.mark.parametrize('row', [0, 1, ROWS - 1])
def test_a_wrong_row_at_an_end_is_mended(row: int) -> None:
    true = 100 + 14 * np.arange(ROWS)
    counts = true.copy()
    counts[row] = np.mod(counts[row] + 1400, 5600)
    found = angles(counts)
    assert found.mended == 1
    assert error_rad(found.angles_rad, true, 5600) < 1e-9


def test_a_row_that_is_half_a_step_back_is_mended() -> None:
    true = 100 + 14 * np.arange(ROWS)
    counts = true.copy()
    counts[200:202] -= [9, 1]
    found = angles(counts)
    assert found.mended == 1
    assert error_rad(found.angles_rad, true, 5600) <= TURN / 5600 + 1e-9


def test_lost_rows_leave_a_gap_and_move_no_other_row() -> None:
    kept = np.delete(np.arange(ROWS), np.r_[50:60, 200, 300:304])
    found = angles(14 * kept)
    assert found.mended == 0
    assert error_rad(found.angles_rad, 14 * kept, 5600) < 1e-9


@pytest.mark.parametrize(
    'counts',
    [
        np.zeros(ROWS),
        np.full(ROWS, 5599),
        14 * np.arange(ROWS)[::-1],
        np.where(np.arange(ROWS) < 391, 0, 14 * np.arange(ROWS)),
        np.repeat(14 * np.arange(100), 4),
        np.repeat(28 * np.arange(201), 2)[:401],
    ],
    ids=['zero', 'constant', 'decreasing', 'zero but for the last', 'repeated', 'every second repeated'],
)
def test_counts_that_do_not_increase_are_refused(counts: np.ndarray) -> None:
    assert cause_of(counts) == 'no_row_angles'


@pytest.mark.parametrize(
    ('counts', 'what'),
    [
        (np.zeros(ROWS), 'are zero in 400 of 400 rows'),
        (np.where(np.arange(ROWS) < 391, 0, 14 * np.arange(ROWS)), 'are zero in 391 of 400 rows'),
        (14 * np.arange(ROWS)[::-1], 'of the 400 rows decrease: expected them to increase'),
        (np.full(ROWS, 5599), 'of the 400 rows do not increase'),
    ],
)
def test_what_is_wrong_with_counts_is_told(counts: np.ndarray, what: str) -> None:
    with pytest.raises(RefusedInput, match=f'the encoder counts {what}: read another form'):
        angles(counts)


def test_rows_that_leave_half_of_the_circle_empty_are_refused() -> None:
    half = 14 * np.arange(200)
    assert cause_of(np.concatenate([half, half])) in ('uneven_rows', 'unsound_rows')


@given(counts=st.lists(st.integers(0, 65535), min_size=1, max_size=60), size=st.integers(8, 65536))
@settings(max_examples=300, deadline=None)
def test_any_counts_give_angles_or_a_refusal(counts: list[int], size: int) -> None:
    try:
        found = angles(np.array(counts), size)
    except RefusedInput as refusal:
        assert refusal.cause in ('no_row_angles', 'unknown_turn', 'unsound_rows', 'uneven_rows')
    else:
        assert len(found.angles_rad) == len(counts)
        assert np.all((found.angles_rad >= 0) & (found.angles_rad < TURN))
