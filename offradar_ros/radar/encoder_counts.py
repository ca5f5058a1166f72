"""Encoder counts of a scan's rows to their angles. What most rows agree on decides; no single count does.

Convention: counts increase clockwise from the encoder's zero, and start again at zero after a full turn.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput

KNOWN_SIZES = (5600, 16000, 65536)
"""Counts of a full turn of the encoders in use, beside the configured one."""
LARGEST_SHARE_MENDED = 0.1
"""Of the rows of a scan, at most this share may have a count (or a stamp) that contradicts the others."""
LARGEST_EMPTY_SHARE = 0.25
"""Of a turn, at most this share may be empty that the number of rows does not explain."""
FEWEST_ROWS = 4
WAY_OUT = (
    'read another form of the recording (polar or ray: --layout), or set radar.row_angles to equal '
    '(rows at equal steps from 0)'
)

# Rows that cover a turn to within this share of it are one turn.
_TURN_TOLERANCE = 0.05
# An image of a few more rows than a turn has starts the next turn.
_MOST_TURNS = 1.25
# A row that fits the sequence counts 1; a row that is lost between two others costs this.
_LOST_ROW = 0.5
_LONGEST_RUN = 256


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RowAngles:
    """Angles of a scan's rows.

    Attributes:
        angles_rad: (A,) float64 in [0, 2π), clockwise from the encoder's zero.
        mended: number of rows whose count contradicts the others: their angle is interpolated.
    """

    angles_rad: NDArray[np.float64]
    mended: int


def step_of(counts: NDArray[np.int64], rows: NDArray[np.intp]) -> float:
    """Counts from one row to the next: the mean of those steps that are near the median; 0 if they do not increase."""
    if len(rows) < 2:
        return 0.0
    steps = np.diff(counts) / np.diff(rows)
    # The lower of two middle ones: between them there may be no step at all.
    lower = (len(steps) - 1) // 2
    median = float(np.partition(steps, lower)[lower])
    if median <= 0.0:
        return 0.0
    return float(np.mean(steps[np.abs(steps - median) <= max(1.0, median / 2.0)]))


def full_turn_counts(step: float, rows: int, encoder_size: int, azimuth_samples: int) -> int | None:
    """Counts of a full turn: the known size that `rows`, else `azimuth_samples` rows, cover at this step; else None."""
    sizes = (encoder_size, *KNOWN_SIZES)
    for turn_rows in (rows, azimuth_samples):
        size = min(sizes, key=lambda size: abs(step * turn_rows / size - 1.0))
        is_turn = abs(step * turn_rows / size - 1.0) <= _TURN_TOLERANCE
        if is_turn and rows <= _MOST_TURNS * turn_rows:
            return size
    return None


def angles_of_counts(
    counts: NDArray[np.int64], written: NDArray[np.bool_], encoder_size: int, azimuth_samples: int, lost: int = 0
) -> RowAngles:
    """Angles of (A,) rows; those of rows that have no count (not `written`) or a wrong one are interpolated.

    `lost` is how many of the rows without a count were measured all the same.

    Raises RefusedInput with cause no_row_angles (the counts do not increase), unknown_turn (the rows cover no full turn
    of a known size), unsound_rows (over `LARGEST_SHARE_MENDED` of the counts are wrong) or uneven_rows (a large part of
    the circle is empty, though there are enough rows).
    """
    rows = np.flatnonzero(written)
    step = step_of(counts[rows], rows) if len(rows) >= FEWEST_ROWS else 0.0
    if step == 0.0:
        raise RefusedInput('no_row_angles', f'{_what_is_wrong(counts[rows], len(counts))}: {WAY_OUT}')
    size = full_turn_counts(step, len(counts), encoder_size, azimuth_samples)
    if size is None:
        raise RefusedInput(
            'unknown_turn',
            f'the encoder advances by {step:.4g} counts a row, {step * len(counts):.0f} over {len(counts)} rows: '
            f'expected a full turn of {", ".join(map(str, dict.fromkeys((encoder_size, *KNOWN_SIZES))))}; set '
            f'radar.encoder_size to the counts of a full turn (or radar.azimuth_samples to its rows), or {WAY_OUT}',
        )
    sound = _in_sequence(counts[rows], rows, step, size)
    mended = len(rows) - int(np.count_nonzero(sound)) + lost
    if mended > max(1.0, LARGEST_SHARE_MENDED * (len(rows) + lost)):
        raise RefusedInput(
            'unsound_rows',
            f'the encoder counts of {mended} of {len(rows) + lost} rows contradict the others: expected at most '
            f'{LARGEST_SHARE_MENDED:.0%}; {WAY_OUT}',
        )
    rows = rows[sound]
    turned = int(counts[rows[0]]) + np.concatenate([[0], np.cumsum(np.mod(np.diff(counts[rows]), size))])
    # The modulo is of counts, where the zero after a full turn is exact.
    at = np.mod(at_every_row(rows, turned.astype(np.float64), step, len(counts)), size)
    _require_even(at, step, size)
    return RowAngles(at * (2 * np.pi / size), mended)


def at_every_row(rows: NDArray[np.intp], values: NDArray[np.float64], step: float, count: int) -> NDArray[np.float64]:
    """(`count`,) values at every row: interpolated between `rows`, and by `step` a row beyond them."""
    every = np.arange(count)
    inside = np.interp(every, rows, values)
    return np.asarray(inside + step * (np.minimum(every - rows[0], 0) + np.maximum(every - rows[-1], 0)))


def _what_is_wrong(counts: NDArray[np.int64], rows: int) -> str:
    if np.count_nonzero(counts) <= len(counts) // 2:
        return f'the encoder counts are zero in {rows - np.count_nonzero(counts)} of {rows} rows'
    if len(counts) >= FEWEST_ROWS and float(np.median(np.diff(counts))) < 0.0:
        return f'the encoder counts of the {rows} rows decrease: expected them to increase'
    return f'the encoder counts of the {rows} rows do not increase'


def _in_sequence(counts: NDArray[np.int64], rows: NDArray[np.intp], step: float, size: int) -> NDArray[np.bool_]:
    """(N,) which counts belong to the longest sequence that advances as an encoder does.

    From one of its rows to the next the count advances by at least half of what is due. More is allowed, as rows may be
    lost between, but costs; so the sequence never follows a wrong count forward, because it must come back by nearly a
    full turn.
    """
    ahead, due = np.mod(np.diff(counts), size), step * np.diff(rows)
    if np.all((ahead >= due / 2.0 - 1.0) & (ahead <= 1.5 * due + 1.0)):
        return np.ones(len(counts), np.bool_)
    run = min(_LONGEST_RUN, len(counts) // 4 + 2)
    score = np.ones(len(counts))
    before = np.full(len(counts), -1)
    for at in range(1, len(counts)):
        first = max(0, at - run)
        ahead = np.mod(counts[at] - counts[first:at], size)
        due = step * (rows[at] - rows[first:at])
        reached = score[first:at] - _LOST_ROW * np.abs(ahead - due) / step
        reached[ahead < due / 2.0 - 1.0] = -np.inf
        best = int(np.argmax(reached))
        if reached[best] > 0.0:
            score[at], before[at] = 1.0 + reached[best], first + best
    sound = np.zeros(len(counts), np.bool_)
    at = int(np.argmax(score))
    while at >= 0:
        sound[at] = True
        at = int(before[at])
    return sound


def _require_even(at: NDArray[np.float64], step: float, size: int) -> None:
    """RefusedInput('uneven_rows') if more of the circle is empty than the number of rows explains."""
    order = np.sort(at)
    gaps = np.diff(order, append=order[0] + size)
    empty = float(np.sum(np.maximum(gaps - 2.5 * step, 0.0))) / size
    explained = max(0.0, 1.0 - len(at) * step / size)
    if empty > explained + LARGEST_EMPTY_SHARE:
        raise RefusedInput(
            'uneven_rows',
            f'the {len(at)} rows leave {empty:.0%} of the circle empty, {explained:.0%} expected of their number: '
            f'their encoder counts repeat or jump; {WAY_OUT}',
        )
