"""Whether the motion of the scans fits that of the positions, or only with their stamps moved."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.geometry import Trajectory
from offradar_ros.positions.clocks import clock_problem
from offradar_ros.radar.motion import Motion, ScanMotion
from offradar_ros.recordings.datasets.check.findings import Finding, note, ok, problem
from offradar_ros.recordings.motion_clock import FEWEST_MOTIONS, motion_offset
from offradar_ros.types import PolarScan

_LEAST_GAIN = 0.15


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
        if len(self._motions) < FEWEST_MOTIONS or not len(trajectory):
            return
        text = self.problem(trajectory, max_gap_s)
        found = motion_offset(self._motions, trajectory, max_gap_s)
        if text:
            yield problem(f'{name}: {text}')
        elif found is None:
            yield note(
                f'{name}: whether its clock is that of the radar cannot be told from the motion: too little turning '
                'and changing of speed, or scans and positions of other drives'
            )
        else:
            yield ok(f'{name}: moves as the scans do (correlation {found.correlation:.2f}): the clocks agree')

    def problem(self, trajectory: Trajectory, max_gap_s: float, given_s: float = 0.0) -> str:
        """By how much the clocks disagree; empty if they agree, or if that cannot be told.

        `given_s` is what was already added to the trajectory's stamps: the offset that is proposed includes it.
        """
        found = motion_offset(self._motions, trajectory, max_gap_s)
        # A broad peak, of a drive with few turns, does not tell a second or two.
        if found is None or found.correlation - found.unmoved < _LEAST_GAIN:
            return ''
        evidence = f'the motion of both (correlation {found.correlation:.2f})'
        return clock_problem(found.offset_s, evidence=evidence, given_s=given_s)
