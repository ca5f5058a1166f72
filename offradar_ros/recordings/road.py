"""Recordings with positions, in one frame: several drives of one road."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.positions.clocks import clock_problem
from offradar_ros.positions.headings import with_headings
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.left_out import left_out_text
from offradar_ros.recordings.source import open_source
from offradar_ros.recordings.spacing import path_length_m, subsample_by_distance
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

ONE_ROAD_M = 50_000.0
"""All positions of one road are within this distance of the start of its first drive."""


@dataclasses.dataclass(frozen=True, eq=False)
class PositionedDrive:
    """The scans of one recording that have a position; a `RadarSequence` of them.

    Attributes:
        path: the bag or data-set folder.
        name: what people call it.
        sequence: where the scans are read from.
        rows: (N,) which of its scans, increasing.
        poses: (N, 3) float64, x and y in metres of the road's frame, and heading in radians (NaN where unknown).
        driven_m: (N,) float64 metres driven up to each scan, from the first one with a position.
        points_lla: (N, 3) float64 latitude°, longitude°, altitude m; None where positions are in metres.
        trajectory: None, as `RadarSequence` allows: positions are in `poses`.
    """

    path: Path
    name: str
    sequence: RadarSequence
    rows: NDArray[np.intp]
    poses: NDArray[np.float64]
    driven_m: NDArray[np.float64]
    points_lla: NDArray[np.float64] | None
    trajectory: None = None

    @property
    def layout(self) -> str:
        """The format it was read from."""
        return self.sequence.layout

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 scan stamps, never decreasing."""
        return self.sequence.stamps_ns[self.rows]

    def __len__(self) -> int:
        return len(self.rows)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, 0 to N − 1; RefusedInput for one without signal, or that cannot be read."""
        return read_or_refuse(self.sequence, int(self.rows[index]))

    def only(self, kept: NDArray[np.intp] | NDArray[np.bool_]) -> PositionedDrive:
        """The drive with some of its scans: indices (M,), increasing, or a mask (N,)."""
        return dataclasses.replace(
            self,
            rows=self.rows[kept],
            poses=self.poses[kept],
            driven_m=self.driven_m[kept],
            points_lla=None if self.points_lla is None else self.points_lla[kept],
        )

    def subsampled(self, spacing_m: float) -> PositionedDrive:
        """The first scan in each stretch of `spacing_m` metres driven; 0 keeps all."""
        return self.only(subsample_by_distance(self.driven_m, spacing_m))


class Road(NamedTuple):
    """Several recordings of one road.

    Attributes:
        drives: in the order of their paths, in one frame.
        notes: what was left out or assumed, one line each.
    """

    drives: list[PositionedDrive]
    notes: list[str]


def open_road(
    paths: Sequence[Path],
    layout: str = 'auto',
    radar: RadarConfig | None = None,
    position: PositionConfig | None = None,
    *,
    name: str = 'road',
    topics: ChosenTopics | None = None,
) -> Road:
    """Open bags and data-set folders as drives in one frame, which starts at the first position of the first one.

    Positions in metres are taken as they are. `name` is the road's, in notes. `topics` chooses among those of
    each bag. DataError for a recording without
    positions, with positions of another kind than the first one's, or that starts over 50 km from it.
    """
    opened = [(path, open_source(path, layout, radar, topics)) for path in paths]
    position = position or PositionConfig()
    drives: list[PositionedDrive] = []
    notes: list[str] = []
    frame: LocalFrame | None = None
    for index, (path, sequence) in enumerate(opened):
        origin = trajectory_of(sequence, path).origin()
        if index == 0:
            frame = LocalFrame(origin) if origin else None
        elif (origin is None) != (frame is None):
            raise DataError(
                f'{path}: expected positions as those of {paths[0]}, in degrees or in metres: they cannot be compared'
            )
        drive = positioned(sequence, path, frame, position)
        trajectory = trajectory_of(sequence, path)
        notes += [left_out_text(sequence.name, left_out) for left_out in trajectory.left_out]
        clocks = clock_problem(trajectory.clock_offset_s)
        notes += [f'{sequence.name}: {clocks}'] if clocks else []
        missing = len(sequence) - len(drive)
        if missing:
            notes.append(f'{sequence.name}: {missing} of {len(sequence)} scans have no position: left out')
        if frame is None and index == 1:
            notes.append(f'{name}: positions are in metres, taken to be of one frame')
        if frame and np.hypot(*drive.poses[0, :2]) > ONE_ROAD_M:
            raise DataError(f'{path}: over {ONE_ROAD_M / 1000:g} km from {paths[0]}')
        drives.append(dataclasses.replace(drive, name=_unique_name(path, paths)))
    return Road(drives, notes)


def positioned(
    sequence: RadarSequence, path: Path, frame: LocalFrame | None, position: PositionConfig
) -> PositionedDrive:
    """The scans that have a position, in metres of `frame`; None takes metric positions as they are.

    Positions are interpolated between neighbours at most `position.max_gap_s` apart; `position.heading` chooses the
    headings. DataError where no scan has a position.
    """
    trajectory = trajectory_of(sequence, path)
    max_gap_ns = round(position.max_gap_s * 1e9)
    rows = np.flatnonzero(trajectory.covers(sequence.stamps_ns, max_gap_ns))
    if not len(rows):
        raise DataError(f'{path}: no scan has a position: offradar check says why')
    stamps_ns = sequence.stamps_ns[rows]
    headed = with_headings(trajectory.in_frame(frame), position.heading, max_gap_ns)
    poses = headed.poses_at(stamps_ns, max_gap_ns)[:, [0, 1, 3]]
    points_lla = trajectory.poses_at(stamps_ns, max_gap_ns)[:, :3] if trajectory.geodetic else None
    return PositionedDrive(path, sequence.name, sequence, rows, poses, path_length_m(poses[:, :2]), points_lla)


def trajectory_of(sequence: RadarSequence, path: Path) -> Trajectory:
    """The sequence's positions; DataError where it has none."""
    trajectory = sequence.trajectory
    if trajectory is None or not len(trajectory):
        raise DataError(f'{path}: expected positions beside the scans, and there are none')
    return trajectory


def read_or_refuse(sequence: RadarSequence, index: int) -> PolarScan:
    """Scan `index`; RefusedInput also where its file or message cannot be read, so that the others are still used."""
    try:
        return sequence.scan(index)
    except DataError as error:
        raise RefusedInput('unreadable', str(error)) from error


class Start(NamedTuple):
    """Where a recording's positions begin.

    Attributes:
        path: the recording.
        name: what people call it.
        origin: its first position; None where positions are in metres.
    """

    path: Path
    name: str
    origin: GeoPoint | None


def start_of(path: Path, layout: str = 'auto', radar: RadarConfig | None = None) -> Start:
    """Where a bag or data-set folder starts; DataError where it has no positions."""
    sequence = open_source(path, layout, radar)
    return Start(path, sequence.name, trajectory_of(sequence, path).origin())


def shared_frames(starts: Sequence[Start]) -> list[Start]:
    """For each recording, the one in whose frame it is: the first that starts within 50 km of it.

    A recording with positions in metres shares its frame with no other: where that frame is, is not known.
    """
    roads: list[tuple[Start, LocalFrame]] = []
    found = []
    for start in starts:
        if start.origin is None:
            found.append(start)
            continue
        first = next((road for road, frame in roads if _distance_m(frame, start.origin) < ONE_ROAD_M), None)
        if first is None:
            first = start
            roads.append((start, LocalFrame(start.origin)))
        found.append(first)
    return found


def _distance_m(frame: LocalFrame, point: GeoPoint) -> float:
    return float(np.linalg.norm(frame.to_enu(np.array([dataclasses.astuple(point)]))))


def _unique_name(path: Path, paths: Sequence[Path]) -> str:
    """The folder's name, after its parent's where another folder has the same name."""
    return path.name if [other.name for other in paths].count(path.name) == 1 else f'{path.parent.name}/{path.name}'
