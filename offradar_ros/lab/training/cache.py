"""Scans on disk, as small as training can use them: made once, found again by what they were made from.

A drive is ``NAME-HASH.npy``, (N, A, B) uint8 polar power reduced along range (`range_reduction`), so that turning a
scan stays an exact roll of its rows; ``NAME-HASH.poses.npy`` (N, 3) float64 x, y, heading;
``NAME-HASH.severities.npy`` (N,) float32; and ``NAME-HASH.json``, written last, with all settings. The hash is of the
settings alone: a drive whose settings are unchanged is never made twice.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros import __version__
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.lab.training.drive import Drive
from offradar_ros.lab.training.range_reduction import range_factor, reduced_power
from offradar_ros.processes import Progress, parallel_map
from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True)
class Reduction:
    """What scans are reduced to: bins as long as fit into `step_m`, to `reach_m`."""

    step_m: float
    reach_m: float

    @classmethod
    def for_image(cls, config: NetworkConfig) -> Reduction:
        """Half a pixel leaves a Cartesian image as it is; half a column of a polar one hardly changes it."""
        return cls(config.resolution_m / 2.0, config.reach_m)


@dataclasses.dataclass(frozen=True, eq=False)
class CachedDrive:
    """N scans of one drive.

    Attributes:
        name: the drive's.
        world: the frame of `poses`.
        power: (N, A, B) uint8, read as it is needed.
        azimuths_rad: (A,) float64.
        range_resolution_m: metres a bin.
        range_offset_m: metres added to every range.
        poses: (N, 3) float64 x, y, heading.
        kinds: N names of what is wrong with a scan, empty for none or not known.
        severities: (N,) float32, NaN where not known.
    """

    name: str
    world: str
    power: NDArray[np.uint8]
    azimuths_rad: NDArray[np.float64]
    range_resolution_m: float
    range_offset_m: float
    poses: NDArray[np.float64]
    kinds: tuple[str, ...]
    severities: NDArray[np.float32]

    def scan(self, row: int, spin: int = 0) -> PolarScan:
        """Scan `row`, turned by `spin` azimuths (see `offradar_ros.radar.spinning`)."""
        power = np.asarray(self.power[row])
        if spin:
            power = np.roll(power, spin, axis=0)
        return PolarScan(row, power, self.azimuths_rad, self.range_resolution_m, self.range_offset_m)


def cached_drives(
    folder: str | Path,
    drives: Sequence[Drive],
    reduction: Reduction,
    workers: int = 0,
    progress: Progress | None = None,
) -> list[CachedDrive]:
    """Every drive, made first where it is not in `folder` yet, by `workers` processes (0: one a core).

    DataError for a drive that cannot be read or a folder that cannot be written. Scans that are damaged are left out.
    """
    folder = Path(folder)
    stems = [_stem(folder, drive, reduction) for drive in drives]
    missing = [(drive, stem) for drive, stem in zip(drives, stems, strict=True) if not _json(stem).is_file()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        parallel_map(_make, [(drive, stem, reduction) for drive, stem in missing], workers, progress)
        return [_read(stem) for stem in stems]
    except OSError as error:
        raise DataError(f'{folder}: the cache cannot be written or read ({error.strerror or error})') from error


def _stem(folder: Path, drive: Drive, reduction: Reduction) -> Path:
    settings = json.dumps(_settings(drive, reduction), sort_keys=True)
    return folder / f'{drive.name}-{hashlib.sha256(settings.encode()).hexdigest()[:16]}'


def _settings(drive: Drive, reduction: Reduction) -> dict[str, object]:
    values = dataclasses.asdict(drive)  # type: ignore[call-overload]
    return {
        'offradar_ros': __version__,
        'kind': type(drive).__name__,
        'drive': values,
        'reduction': dataclasses.asdict(reduction),
    }


def _json(stem: Path) -> Path:
    return stem.with_name(stem.name + '.json')


def _make(drive: Drive, stem: Path, reduction: Reduction) -> None:
    """Write one drive's files."""
    opened = drive.open()
    rows: list[int] = []
    power: NDArray[np.uint8] | None = None
    first: PolarScan | None = None
    partial = stem.with_name(f'.{stem.name}.{os.getpid()}.npy')
    for row, index in enumerate(opened.indices.tolist()):
        try:
            scan = opened.sequence.scan(index)
        except (DataError, RefusedInput):
            continue
        if first is None or power is None:
            first, azimuths = scan, np.sort(scan.azimuths_rad)
            reduced = reduced_power(scan, reduction.step_m, reduction.reach_m, azimuths)
            shape = (len(opened.indices), *reduced.shape)
            power = np.lib.format.open_memmap(partial, mode='w+', dtype=np.uint8, shape=shape)
        elif not _alike(scan, first):
            continue
        else:
            reduced = reduced_power(scan, reduction.step_m, reduction.reach_m, azimuths)
        power[len(rows)] = reduced
        rows.append(row)
    if first is None or power is None:
        raise DataError(f'{drive.name}: no scan of it can be read')
    del power
    partial.replace(stem.with_name(stem.name + '.npy'))
    np.save(stem.with_name(stem.name + '.poses.npy'), opened.poses[rows], allow_pickle=False)
    np.save(stem.with_name(stem.name + '.severities.npy'), opened.severities[rows], allow_pickle=False)
    description = {
        **_settings(drive, reduction),
        'name': drive.name,
        'world': drive.world,
        'scans': len(rows),
        'left_out': len(opened.indices) - len(rows),
        'range_resolution_m': first.range_resolution_m * range_factor(first.range_resolution_m, reduction.step_m),
        'range_offset_m': first.range_offset_m,
        'azimuths_rad': azimuths.tolist(),
        'kinds': [opened.kinds[row] for row in rows],
    }
    unfinished = stem.with_name(f'.{stem.name}.{os.getpid()}.json')
    unfinished.write_text(json.dumps(description), encoding='utf-8')
    unfinished.replace(_json(stem))


def _alike(scan: PolarScan, first: PolarScan) -> bool:
    return (
        scan.power.shape == first.power.shape
        and scan.range_resolution_m == first.range_resolution_m
        and scan.range_offset_m == first.range_offset_m
    )


def _read(stem: Path) -> CachedDrive:
    path = _json(stem)
    try:
        said = json.loads(path.read_text(encoding='utf-8'))
        count = said['scans']
        drive = CachedDrive(
            name=said['name'],
            world=said['world'],
            power=np.load(stem.with_name(stem.name + '.npy'), mmap_mode='r', allow_pickle=False)[:count],
            azimuths_rad=np.array(said['azimuths_rad'], np.float64),
            range_resolution_m=float(said['range_resolution_m']),
            range_offset_m=float(said['range_offset_m']),
            poses=np.load(stem.with_name(stem.name + '.poses.npy'), allow_pickle=False),
            kinds=tuple(said['kinds']),
            severities=np.load(stem.with_name(stem.name + '.severities.npy'), allow_pickle=False),
        )
    except (ValueError, KeyError, TypeError, EOFError) as error:
        raise DataError(f'{path}: not a cached drive ({error}): remove it to make it again') from error
    if not len(drive.power) == len(drive.poses) == len(drive.kinds) == len(drive.severities) == count:
        raise DataError(f'{path}: its files do not belong together: remove it to make it again')
    return drive
