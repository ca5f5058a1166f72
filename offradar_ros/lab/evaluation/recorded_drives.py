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
from offradar_ros.lab.evaluation.evaluated_drive import EvaluatedDrive
from offradar_ros.lab.evaluation.protocol import VALIDATION, Group, Protocol, Recorded
from offradar_ros.recordings.datasets.splits import Split, read_split
from offradar_ros.recordings.road import PositionedDrive, open_road, read_or_refuse
from offradar_ros.recordings.source import open_source
from offradar_ros.sequence import RadarSequence


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
        return open_source(self.path(name), self.layout, self.radar)

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
    paths = [source.path(part.name) for part in parts]
    opened = open_road(paths, source.layout, source.radar, source.position, name=road.name)
    lacking += opened.notes
    for index, (part, whole) in enumerate(zip(parts, opened.drives, strict=True)):
        drive = _tested(split, whole).subsampled(protocol.drive_spacing_m)
        if not len(drive):
            lacking.append(f'{whole.sequence.name}: no scan is in the test region of {road.split}: left out')
            continue
        made = _drive(group.name, road.name, index, drive.sequence, drive.rows, drive.poses, drive.driven_m, part)
        yield dataclasses.replace(made, title=drive.name)


def _tested(split: Split | None, drive: PositionedDrive) -> PositionedDrive:
    if split is None or not split.region:
        return drive
    if drive.points_lla is None:
        raise DataError(
            f'{drive.path}: expected positions in degrees, for the test region, got metres of a frame of its own'
        )
    return drive.only(split.tested(drive.points_lla))


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
        read_scan=lambda row: read_or_refuse(sequence, int(rows[row])),
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
