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

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.drives import SimulatedDrive
from offradar_ros.lab.evaluation.evaluated_drive import EvaluatedDrive
from offradar_ros.lab.simulation.source_digest import source_digest
from offradar_ros.processes import Progress, shared_out
from offradar_ros.types import PolarScan


def cached_drives(
    drives: Sequence[SimulatedDrive], folder: Path, progress: Progress, processes: int = 0
) -> list[EvaluatedDrive]:
    """The drives, in their order; those not in `folder` yet are rendered, several at a time.

    `progress` is told of drives done and their number. DataError where the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{folder}: expected a folder for simulated scans ({error.strerror})') from None
    for partial in folder.glob('*.partial.*'):
        if not Path('/proc', partial.name.split('.')[-3]).exists():
            partial.unlink(missing_ok=True)
    paths = {drive: _json_path(folder, drive) for drive in drives}
    missing = [drive for drive, path in paths.items() if not path.is_file()]
    shared_out(render, [(drive, paths[drive]) for drive in missing], processes, progress)
    return [_load(drive, paths[drive]) for drive in drives]


def render(drive: SimulatedDrive, target: Path) -> None:
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


def _load(drive: SimulatedDrive, path: Path) -> EvaluatedDrive:
    try:
        known = json.loads(path.read_text(encoding='utf-8'))
        power = np.load(path.with_suffix('.npy'), mmap_mode='r', allow_pickle=False)
        stamps_ns = np.array(known['stamps_ns'], np.int64)
        azimuths_rad = np.array(known['azimuths_rad'], np.float64)
        resolution_m = float(known['range_resolution_m'])
        return EvaluatedDrive(
            group=drive.group,
            world=drive.world,
            index=drive.index,
            key=path.stem,
            stamps_ns=stamps_ns,
            poses=np.array(known['poses'], np.float64),
            driven_m=np.array(known['driven_m'], np.float64),
            kinds=np.array(known['kinds'], np.str_),
            severities=np.array(known['severities'], np.float64),
            read_scan=lambda index: PolarScan(
                int(stamps_ns[index]), np.array(power[index]), azimuths_rad, resolution_m
            ),
        )
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise DataError(f'{path}: damaged simulated drive ({error}): remove it to have it rendered again') from None


def _json_path(folder: Path, drive: SimulatedDrive) -> Path:
    settings = json.dumps(dataclasses.asdict(drive) | {'group': '', 'folder': ''}, sort_keys=True, default=str)
    digest = hashlib.sha256((settings + source_digest() + drive.source_digest()).encode()).hexdigest()
    return folder / f'{drive.world}_{drive.index + 1}_{digest[:16]}.json'
