"""The recorded drives of a protocol: opened, in one frame, and subsampled by distance."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.drives.recorded import drive_of_scans, part_of_split, recorded_drive
from offradar_ros.lab.evaluation.protocol import VALIDATION, Group, Protocol, Recorded
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.datasets.splits import read_split
from offradar_ros.recordings.road import open_road
from offradar_ros.recordings.source import open_source


class Recordings(NamedTuple):
    """The recorded drives of a protocol.

    Attributes:
        drives: that were opened.
        notes: on what is missing or was left out, one line each.
    """

    drives: list[Drive]
    notes: list[str]


@dataclasses.dataclass(frozen=True)
class RecordedSource:
    """Where recorded drives are and how they are read.

    `root` is the folder of those that a protocol names; `topics` are chosen of each bag.
    """

    root: Path | None = None
    radar: RadarConfig = dataclasses.field(default_factory=RadarConfig)
    position: PositionConfig = dataclasses.field(default_factory=PositionConfig)
    topics: ChosenTopics = dataclasses.field(default_factory=ChosenTopics)

    def path(self, name: str) -> Path:
        """Path of a folder that a protocol names."""
        return self.root / name if self.root else Path(name)


def recorded_drives(protocol: Protocol, source: RecordedSource) -> Recordings:
    """Drives of every recorded road of the protocol, and its validation drives; DataError for an unusable one.

    A missing folder is noted. A road needs two drives, one that is mapped and another that is searched for.
    """
    drives: list[Drive] = []
    notes: list[str] = []
    for group in protocol.groups:
        for road in group.recorded:
            named = list(_named(road))
            found = [part for part in named if source.path(part.name).exists()]
            missing = [part.name for part in named if part not in found]
            if missing:
                notes.append(f'{road.name}: not found: {", ".join(missing)}{_where(source)}')
            if _enough(found, protocol):
                drives += _opened(group, road, found, protocol, source, notes)
    for name in protocol.validation.sequences:
        if source.path(name).exists():
            drives.append(_validation(name, protocol, source))
        else:
            notes.append(f'{name}: not found{_where(source)}: no validation on it')
    return Recordings(drives, notes)


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
    group: Group, road: Recorded, parts: Sequence[_Part], protocol: Protocol, source: RecordedSource, notes: list[str]
) -> Iterator[Drive]:
    split = read_split(road.split) if road.split else None
    paths = [source.path(part.name) for part in parts]
    opened = open_road(paths, radar=source.radar, position=source.position, name=road.name, topics=source.topics)
    notes += opened.notes
    for index, (part, whole) in enumerate(zip(parts, opened.drives, strict=True)):
        tested = part_of_split(whole, split, tested=True) if split else whole
        if not len(tested):
            notes.append(f'{whole.sequence.name}: no scan is in the test region of {road.split}: left out')
            continue
        drive = recorded_drive(tested.subsampled(protocol.drive_spacing_m), road.name)
        yield dataclasses.replace(drive, group=group.name, index=index, mapped=part.mapped, queried=part.queried)


def _validation(name: str, protocol: Protocol, source: RecordedSource) -> Drive:
    """Scans at equal steps of a recording, without their positions, which validation does not use."""
    sequence = open_source(source.path(name), radar=source.radar, topics=source.topics)
    rows = np.unique(np.linspace(0, len(sequence) - 1, protocol.validation.scans).round().astype(np.intp))
    drive = drive_of_scans(sequence, rows, f'{name}_1', name)
    return dataclasses.replace(drive, group=VALIDATION, mapped=False, queried=False)
