"""Recorded traversals as drives of an evaluation: opened, put into one frame, and thinned as the protocol says."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import LocalFrame, Trajectory
from offradar_ros.lab.evaluation.evaluated_drive import EvaluatedDrive
from offradar_ros.lab.evaluation.protocol import VALIDATION, Group, Protocol, Recorded
from offradar_ros.recordings.bags.reader import is_bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.datasets.registry import open_sequence
from offradar_ros.recordings.datasets.splits import Split, read_split
from offradar_ros.recordings.spacing import one_a_cell, way_driven
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

ONE_ROAD_M = 50_000.0
"""Positions of one road are all within this of where the first of its drives starts."""


class Recordings(NamedTuple):
    """What was opened, and what of the protocol was not there."""

    drives: list[EvaluatedDrive]
    lacking: list[str]


@dataclasses.dataclass(frozen=True)
class RecordedSource:
    """Where recorded drives are and how they are read: `root` holds the folders that a protocol names, if given.

    `layout` is that of every data-set folder among them; auto recognises each.
    """

    root: Path | None = None
    radar: RadarConfig = dataclasses.field(default_factory=RadarConfig)
    position: PositionConfig = dataclasses.field(default_factory=PositionConfig)
    layout: str = 'auto'

    def open(self, name: str) -> RadarSequence:
        """The sequence at a path, or of a name in `root`."""
        path = self.path(name)
        return BagSequence(path, self.radar) if is_bag(path) else open_sequence(path, self.layout, self.radar)

    def path(self, name: str) -> Path:
        """Where a folder that a protocol names would be."""
        return self.root / name if self.root else Path(name)


def recorded_drives(protocol: Protocol, source: RecordedSource) -> Recordings:
    """Drives of every recorded road of the protocol, and of its validation sequences; DataError for unusable ones.

    Folders that are missing are told of; a road needs two drives, of which one is mapped and another searched for.
    """
    drives: list[EvaluatedDrive] = []
    lacking: list[str] = []
    for group in protocol.groups:
        for road in group.recorded:
            named = list(_named(road))
            found = [part for part in named if source.path(part.name).exists()]
            missing = [part.name for part in named if part not in found]
            if missing:
                lacking.append(f'{road.name}: not found: {", ".join(missing)}{_where(source)}')
            if _enough(found, protocol):
                drives += _opened(group, road, found, protocol, source, lacking)
    for name in protocol.validation.sequences:
        if source.path(name).exists():
            drives.append(_validation(name, protocol, source))
        else:
            lacking.append(f'{name}: not found{_where(source)}: no validation on it')
    return Recordings(drives, lacking)


class _Part(NamedTuple):
    """A folder and its role."""

    name: str
    mapped: bool
    queried: bool


def _named(road: Recorded) -> Iterator[_Part]:
    test = read_split(road.split).test if road.split else ()
    yield from (_Part(name, True, True) for name in (*test, *road.sequences))
    yield from (_Part(name, True, False) for name in road.maps)
    yield from (_Part(name, False, True) for name in road.queries)


def _where(source: RecordedSource) -> str:
    return f' in {source.root}' if source.root else ' (--data DIR)'


def _enough(parts: Sequence[_Part], protocol: Protocol) -> bool:
    pairs = sum(m.mapped and q.queried and m is not q for m in parts for q in parts)
    return pairs > 0 or (protocol.exclusion_s > 0.0 and any(part.mapped and part.queried for part in parts))


def _opened(
    group: Group,
    road: Recorded,
    parts: Sequence[_Part],
    protocol: Protocol,
    source: RecordedSource,
    lacking: list[str],
) -> Iterator[EvaluatedDrive]:
    split = read_split(road.split) if road.split else None
    frame: LocalFrame | None = None
    for index, part in enumerate(parts):
        path, sequence = source.path(part.name), source.open(part.name)
        trajectory = sequence.trajectory
        if trajectory is None or not len(trajectory):
            raise DataError(f'{path}: evaluation needs positions, and there are none')
        origin = trajectory.origin()
        if index == 0:
            frame = LocalFrame(origin) if origin else None
        elif (origin is None) != (frame is None):
            raise DataError(
                f'{path}: expected positions as those of {parts[0].name}, in degrees or in metres of a frame of its '
                'own: they cannot be compared'
            )
        poses = _poses(sequence.stamps_ns, trajectory.in_frame(frame), source.position.max_gap_s)
        known = np.flatnonzero(np.isfinite(poses[:, 0]))
        if not len(known):
            raise DataError(f'{path}: no scan has a position: offradar check says why')
        if len(known) < len(poses):
            lacking.append(
                f'{sequence.name}: {len(poses) - len(known)} of {len(poses)} scans have no position: left out'
            )
        if frame is None and index == 1:
            lacking.append(f'{road.name}: positions are in metres, taken to be of one frame')
        if frame and np.hypot(*poses[known[0], :2]) > ONE_ROAD_M:
            raise DataError(f'{path}: over {ONE_ROAD_M / 1000:g} km from {parts[0].name}')
        driven_m = way_driven(poses[known, :2])
        tested = np.flatnonzero(_tested(split, poses[known], frame, path))
        kept = tested[one_a_cell(driven_m[tested], protocol.drive_spacing_m)]
        if not len(kept):
            lacking.append(f'{sequence.name}: no scan is in the test region of {road.split}: left out')
            continue
        drive = _drive(group.name, road.name, index, sequence, known[kept], poses[known[kept]], driven_m[kept], part)
        yield dataclasses.replace(drive, title=_title(path, [source.path(other.name) for other in parts]))


def _title(path: Path, paths: Sequence[Path]) -> str:
    """The folder's name, with that of the folder it is in where another is called the same."""
    return path.name if [other.name for other in paths].count(path.name) == 1 else f'{path.parent.name}/{path.name}'


def _poses(stamps_ns: NDArray[np.int64], metric: Trajectory, max_gap_s: float) -> NDArray[np.float64]:
    """(N, 3) x, y and heading at (N,) stamps, NaN where unknown."""
    poses = np.full((len(stamps_ns), 3), np.nan)
    for row, stamp_ns in enumerate(stamps_ns.tolist()):
        pose = metric.at(stamp_ns, round(max_gap_s * 1e9))
        if pose:
            poses[row] = pose.x_m, pose.y_m, pose.yaw_rad
    return poses


def _tested(split: Split | None, poses: NDArray[np.float64], frame: LocalFrame | None, path: Path) -> NDArray[np.bool_]:
    if split is None or not split.region:
        return np.ones(len(poses), np.bool_)
    if frame is None:
        raise DataError(f'{path}: expected positions in degrees, for the test region, got metres of a frame of its own')
    return split.tested(frame.to_geodetic(np.column_stack([poses[:, :2], np.zeros(len(poses))])))


def _validation(name: str, protocol: Protocol, source: RecordedSource) -> EvaluatedDrive:
    """So many scans, evenly spread; where they were taken does not matter."""
    sequence = source.open(name)
    rows = np.unique(np.linspace(0, len(sequence) - 1, protocol.validation.scans).round().astype(np.intp))
    unknown = np.full((len(rows), 3), np.nan)
    return _drive(VALIDATION, name, 0, sequence, rows, unknown, np.zeros(len(rows)), _Part(name, False, False))


def _drive(
    group: str,
    world: str,
    index: int,
    sequence: RadarSequence,
    rows: NDArray[np.intp],
    poses: NDArray[np.float64],
    driven_m: NDArray[np.float64],
    part: _Part,
) -> EvaluatedDrive:
    def read_scan(row: int) -> PolarScan:
        try:
            return sequence.scan(int(rows[row]))
        except DataError as error:
            raise RefusedInput('unreadable', str(error)) from error

    return EvaluatedDrive(
        group=group,
        world=world,
        index=index,
        key=f'{sequence.name}_{_digest(sequence, rows)}',
        stamps_ns=sequence.stamps_ns[rows],
        poses=poses,
        driven_m=driven_m,
        kinds=np.full(len(rows), ''),
        severities=np.full(len(rows), np.nan),
        read_scan=read_scan,
        mapped=part.mapped,
        queried=part.queried,
        layout=sequence.layout,
    )


def _digest(sequence: RadarSequence, rows: NDArray[np.intp]) -> str:
    """Of the stamps, and of the first scan that can be read: how the radar is read is in it too."""
    digest = hashlib.sha256(sequence.stamps_ns[rows].tobytes())
    for row in rows.tolist():
        try:
            scan = sequence.scan(row)
        except (DataError, RefusedInput):
            continue
        digest.update(scan.power.tobytes() + scan.azimuths_rad.tobytes() + repr(scan.range_resolution_m).encode())
        break
    return digest.hexdigest()[:16]
