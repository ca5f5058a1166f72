"""Whether the clocks of radar and positions agree, from the motion that each of them shows.

The speed and the turns of the vehicle are in the scans and in the positions. Where they fit only with the positions'
stamps moved, the clocks disagree by that much. A straight drive at constant speed cannot tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import LocalFrame, Trajectory, wrap_angle
from offradar_ros.radar.motion import Motion
from offradar_ros.recordings.datasets.coverage import span_ns

LARGEST_S = 120.0
"""Larger offsets are not looked for."""
FEWEST_MOTIONS = 60
"""Fewer scans, or positions, cannot tell."""
_STEP_S = 0.1
_HALF_S = 0.75
_SLOWEST_MPS = 1.0
_SHORTEST_OVERLAP_S = 30.0
_LEAST_OVERLAP = 0.4
_SMOOTHED = 5
_LEAST_SPEED_CHANGE = 0.5
_LEAST_TURNING = 0.03
_LEAST_CORRELATION = 0.5
_LEAST_LEAD = 0.1
_NEIGHBOURS_S = 4.0


class MotionOffset(NamedTuple):
    """What the motion says of the clocks.

    Attributes:
        offset_s: seconds to add to the positions' stamps.
        correlation: of the motion of scans and positions with that offset, −1 to 1.
        unmoved: the same without an offset; NaN where too few scans have a position then.
    """

    offset_s: float
    correlation: float
    unmoved: float


def motion_offset(motions: Sequence[Motion], trajectory: Trajectory, max_gap_s: float) -> MotionOffset | None:
    """The offset with which both motions fit, within ±120 s; None where that cannot be told."""
    if len(motions) < FEWEST_MOTIONS or len(trajectory) < FEWEST_MOTIONS:
        return None
    base_ns, last_ns = span_ns(np.array([motion.stamp_ns for motion in motions]))
    used = [motion for motion in motions if base_ns <= motion.stamp_ns <= last_ns]
    times_s = np.array([(motion.stamp_ns - base_ns) / 1e9 for motion in used])
    moved = np.array([(motion.speed_mps, motion.turn_rate) for motion in used])
    seen = np.stack([_smoothed(column) for column in moved.T])
    grid_s, known = _known_motion(trajectory, base_ns, max_gap_s)
    if len(grid_s) < 2:
        return None
    offsets_s = np.arange(-round(LARGEST_S / _STEP_S), round(LARGEST_S / _STEP_S) + 1) * _STEP_S
    scores = np.array([_score(times_s, seen, grid_s, known, offset_s) for offset_s in offsets_s])
    if not np.isfinite(scores).any():
        return None
    best = int(np.nanargmax(scores))
    apart = np.abs(offsets_s - offsets_s[best]) > _NEIGHBOURS_S
    others = scores[apart & np.isfinite(scores)]
    lead = scores[best] - others.max(initial=-1.0)
    if scores[best] < _LEAST_CORRELATION or lead < _LEAST_LEAD or best in (0, len(scores) - 1):
        return None
    return MotionOffset(float(offsets_s[best]), float(scores[best]), float(scores[len(scores) // 2]))


def _known_motion(
    trajectory: Trajectory, base_ns: int, max_gap_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) seconds since `base_ns`, and (2, N) speed in m/s and turn rate in rad/s there; NaN where unknown."""
    origin = trajectory.origin()
    metric = trajectory.in_frame(LocalFrame(origin) if origin else None)
    seconds = (metric.stamps_ns - base_ns) / 1e9
    count = int((seconds[-1] - seconds[0]) / _STEP_S)
    grid_s = seconds[0] + _STEP_S * np.arange(min(count, 10**6))
    half_ns, gap_ns = round(_HALF_S * 1e9), round(max_gap_s * 1e9)
    stamps_ns = base_ns + np.rint(grid_s * 1e9).astype(np.int64)
    before, here, after = (metric.poses_at(stamps_ns + shift_ns, gap_ns)[:, :2] for shift_ns in (-half_ns, 0, half_ns))
    speed = np.hypot(*(after - before).T) / (2 * _HALF_S)
    first, second = here - before, after - here
    turn = wrap_angle(np.arctan2(second[:, 1], second[:, 0]) - np.arctan2(first[:, 1], first[:, 0])) / _HALF_S
    return grid_s, np.stack([speed, np.where(speed < _SLOWEST_MPS, 0.0 * speed, turn)])


def _score(
    times_s: NDArray[np.float64],
    seen: NDArray[np.float64],
    grid_s: NDArray[np.float64],
    known: NDArray[np.float64],
    offset_s: float,
) -> float:
    """Mean correlation of the signals that vary; NaN where too few scans have a position, or nothing varies."""
    index = np.rint((times_s - offset_s - grid_s[0]) / _STEP_S).astype(np.intp)
    inside = (index >= 0) & (index < len(grid_s))
    inside[inside] = np.isfinite(known[:, index[inside]]).all(axis=0)
    duration_s = float(np.ptp(times_s))
    overlap_s = duration_s * float(np.mean(inside))
    if overlap_s < max(_SHORTEST_OVERLAP_S, _LEAST_OVERLAP * duration_s):
        return np.nan
    scores = []
    for of_scans, of_positions, least in zip(
        seen[:, inside], known[:, index[inside]], (_LEAST_SPEED_CHANGE, _LEAST_TURNING), strict=True
    ):
        if of_positions.std() >= least and of_scans.std() > 0.0:
            scores.append(float(np.corrcoef(of_scans, of_positions)[0, 1]))
    return float(np.mean(scores)) if scores else np.nan


def _smoothed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Medians of 5 neighbours: one scan that does not fit the others must not count."""
    padded = np.pad(values, _SMOOTHED // 2, mode='edge')
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, _SMOOTHED), axis=1))
