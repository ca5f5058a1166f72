"""Simulated drives on disk: rendered once, then read as fast as the disk gives them.

``KEY.npy`` holds (N, A, R) uint8 power and is mapped, not read; ``KEY.json`` what is known of each scan. KEY is made
from everything that the scans depend on, the simulator's source included.
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

from offradar_ros.errors import DataError
from offradar_ros.evaluation.drives import Drive
from offradar_ros.processes import Progress, shared_out
from offradar_ros.simulation.source_digest import source_digest
from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True, eq=False)
class CachedDrive:
    """The scans of a simulated drive and the truth about each; a `RadarSequence` without positions of its own.

    Attributes:
        group: of the protocol.
        world: frame of `poses`; drives of one world are searched from each other.
        index: which of the world's drives.
        key: of the scans.
        power: (N, A, R) uint8.
        azimuths_rad: (A,) float64.
        range_resolution_m: metres a bin.
        stamps_ns: (N,) int64.
        poses: (N, 3) float64, x and y in metres of the world and heading in radians.
        driven_m: (N,) float64 way driven before each scan.
        kinds: (N,) text, what is wrong with each scan; empty for clean ones.
        severities: (N,) float64, 0 for clean scans to 1.
    """

    group: str
    world: str
    index: int
    key: str
    power: NDArray[np.uint8]
    azimuths_rad: NDArray[np.float64]
    range_resolution_m: float
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    driven_m: NDArray[np.float64]
    kinds: NDArray[np.str_]
    severities: NDArray[np.float64]
    layout: str = 'simulation'
    trajectory: None = None

    @property
    def name(self) -> str:
        """World and number of the drive."""
        return f'{self.world}_{self.index + 1}'

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, a copy."""
        return PolarScan(
            stamp_ns=int(self.stamps_ns[index]),
            power=np.array(self.power[index]),
            azimuths_rad=self.azimuths_rad,
            range_resolution_m=self.range_resolution_m,
        )


def cached_drives(drives: Sequence[Drive], folder: Path, progress: Progress, processes: int = 0) -> list[CachedDrive]:
    """The drives, in their order; those not in `folder` yet are rendered, several at a time.

    `progress` is told of drives done and their number. DataError where the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{folder}: expected a folder for simulated scans ({error.strerror})') from None
    paths = {drive: _json_path(folder, drive) for drive in drives}
    missing = [drive for drive, path in paths.items() if not path.is_file()]
    shared_out(render, [(drive, paths[drive]) for drive in missing], processes, progress)
    return [_load(drive, paths[drive]) for drive in drives]


def render(drive: Drive, target: Path) -> None:
    """Simulate a drive into `target`, a JSON file that is written last, so that what has one is whole."""
    sequence, indices, driven_m = drive.simulate()
    sensor = sequence.sensor
    partial = target.with_suffix(f'.{os.getpid()}.partial.npy')
    shape = (len(indices), sensor.azimuths, sensor.range_bins)
    power = np.lib.format.open_memmap(partial, 'w+', np.uint8, shape)
    for row, index in enumerate(indices.tolist()):
        scan = sequence.scan(index)
        power[row] = scan.power
    power.flush()
    partial.replace(target.with_suffix('.npy'))
    faults = [sequence.degradations[index] for index in indices]
    known = {
        'azimuths_rad': scan.azimuths_rad.tolist(),
        'range_resolution_m': scan.range_resolution_m,
        'stamps_ns': sequence.stamps_ns[indices].tolist(),
        'poses': sequence.poses[indices].tolist(),
        'driven_m': driven_m.tolist(),
        'kinds': [fault.kind.value if fault else '' for fault in faults],
        'severities': [float(fault.severity) if fault else 0.0 for fault in faults],
        'drive': dataclasses.asdict(drive),
    }
    text = target.with_suffix(f'.{os.getpid()}.partial.json')
    text.write_text(json.dumps(known), encoding='utf-8')
    text.replace(target)


def _load(drive: Drive, path: Path) -> CachedDrive:
    try:
        known = json.loads(path.read_text(encoding='utf-8'))
        return CachedDrive(
            group=drive.group,
            world=drive.world,
            index=drive.index,
            key=path.stem,
            power=np.load(path.with_suffix('.npy'), mmap_mode='r', allow_pickle=False),
            azimuths_rad=np.array(known['azimuths_rad'], np.float64),
            range_resolution_m=known['range_resolution_m'],
            stamps_ns=np.array(known['stamps_ns'], np.int64),
            poses=np.array(known['poses'], np.float64),
            driven_m=np.array(known['driven_m'], np.float64),
            kinds=np.array(known['kinds'], np.str_),
            severities=np.array(known['severities'], np.float64),
        )
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise DataError(f'{path}: damaged simulated drive ({error}): remove it to have it rendered again') from None


def _json_path(folder: Path, drive: Drive) -> Path:
    settings = json.dumps(dataclasses.asdict(drive) | {'group': '', 'folder': ''}, sort_keys=True, default=str)
    digest = hashlib.sha256((settings + source_digest() + drive.source_digest()).encode()).hexdigest()
    return folder / f'{drive.world}_{drive.index + 1}_{digest[:16]}.json'
