"""Whether the motion of the scans fits that of the positions, or only with their stamps moved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from offradar_ros.geometry import LocalFrame, Trajectory
from offradar_ros.positions.clocks import OFFSET_S, clock_problem
from offradar_ros.radar.motion import Motion, ScanMotion
from offradar_ros.recordings.datasets.check.findings import Finding, note, ok, problem
from offradar_ros.recordings.datasets.coverage import span_ns
from offradar_ros.recordings.motion_clock import FEWEST_MOTIONS, MotionOffset, motion_offset
from offradar_ros.types import PolarScan

_LEAST_GAIN = 0.15
_FEWEST_MOVING = 8
_STANDING_M = 3.0
_MOVING_MPS, _FASTEST_MPS = 3.0, 60.0
_SPREAD = 0.5


class ScanClock:
    """Collects the motion of scans in their order."""

    def __init__(self) -> None:
        self._motion = ScanMotion()
        self._motions: list[Motion] = []

    def add(self, scan: PolarScan) -> None:
        """Add the next scan."""
        motion = self._motion.add(scan)
        if motion is not None:
            self._motions.append(motion)

    def findings(self, name: str, trajectory: Trajectory, max_gap_s: float) -> Iterator[Finding]:
        """What the motion says of the clocks; nothing for a recording too short to tell."""
        if not len(trajectory):
            return
        standing = self._standing(trajectory)
        if standing:
            yield problem(f'{name}: {standing}')
            return
        if len(self._motions) < FEWEST_MOTIONS:
            return
        found = motion_offset(self._motions, trajectory, max_gap_s)
        text = _disagreement(found)
        if text:
            yield problem(f'{name}: {text}')
        elif found is None or abs(found.offset_s) >= OFFSET_S:
            yield note(
                f'{name}: whether its clock is that of the radar cannot be told from the motion: too little turning '
                'and changing of speed, or scans and positions of other drives'
            )
        else:
            yield ok(f'{name}: moves as the scans do (correlation {found.correlation:.2f}): the clocks agree')

    def problem(self, trajectory: Trajectory, max_gap_s: float, given_s: float = 0.0) -> str:
        """By how much the clocks disagree, or that only the scans move; empty if all agree, or if that cannot be told.

        `given_s` is what was already added to the trajectory's stamps: the offset that is proposed includes it.
        """
        return self._standing(trajectory) or _disagreement(motion_offset(self._motions, trajectory, max_gap_s), given_s)

    def _standing(self, trajectory: Trajectory) -> str:
        """That the positions stand still while the scans move; empty if they do not."""
        if len(self._motions) < _FEWEST_MOVING or not len(trajectory):
            return ''
        origin = trajectory.origin()
        metric = trajectory.in_frame(LocalFrame(origin) if origin else None)
        first_ns, last_ns = span_ns(np.array([motion.stamp_ns for motion in self._motions]))
        during = (metric.stamps_ns >= first_ns) & (metric.stamps_ns <= last_ns)
        if not during.any():
            return ''
        extent_m = float(np.ptp(metric.positions[during, :2], axis=0).max())
        speeds_mps = np.array([motion.speed_mps for motion in self._motions])
        speed_mps = float(np.median(speeds_mps))
        # Scans without structure give any speed, and each another.
        is_steady = float(np.median(np.abs(np.diff(speeds_mps)))) <= _SPREAD * speed_mps
        is_known = _MOVING_MPS <= speed_mps <= _FASTEST_MPS and is_steady
        if extent_m > _STANDING_M or not is_known:
            return ''
        return (
            f'the positions stay within {extent_m:.1f} m while the scans move at about {speed_mps:.0f} m/s: the '
            'receiver repeats an old one, or they are of another drive'
        )


def _disagreement(found: MotionOffset | None, given_s: float = 0.0) -> str:
    # A broad peak, of a drive with few turns, does not tell a second or two.
    if found is None or found.correlation - found.unmoved < _LEAST_GAIN:
        return ''
    evidence = f'the motion of both (correlation {found.correlation:.2f})'
    return clock_problem(found.offset_s, evidence=evidence, given_s=given_s)
