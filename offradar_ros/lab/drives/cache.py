"""A cache of drives on disk: each is rendered or read once.

``KEY.npy`` holds (N, A, R) uint8 power, reduced along range or not, and is memory-mapped; ``KEY.json``, which is
written last, holds the columns of each scan. KEY is the drive's name and a hash of everything that its scans depend
on: a drive whose settings are unchanged is never made twice.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from offradar_ros import __version__
from offradar_ros.bounded_input import parse_json, read_bounded
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.lab.array_file import map_array
from offradar_ros.lab.drives.drive import Drive, DriveSource
from offradar_ros.lab.drives.range_reduction import Reduction, at_azimuths
from offradar_ros.processes import Progress, parallel_map
from offradar_ros.types import PolarScan
from offradar_ros.whole_file import whole_file, write_whole_file

_PARTIAL = '.partial'
_FORM = 2
"""Of the files; those of another form are made again."""
_MOST_APART_NS = 2_000_000
"""In this time a vehicle moves by centimetres."""
_LARGEST_HEADER = 256 * 1024**2

COLUMNS: dict[str, Any] = {
    'stamps_ns': np.int64,
    'poses': np.float64,
    'driven_m': np.float64,
    'kinds': np.str_,
    'severities': np.float64,
}
"""Columns with one entry per scan, in the order of `Drive`, and their types."""


def cached_drives(
    sources: Sequence[DriveSource],
    folder: Path,
    *,
    reduction: Reduction | None = None,
    processes: int = 0,
    progress: Progress | None = None,
) -> list[Drive]:
    """The drives, in their order; those not yet in `folder` are made by `processes` (0: one per core).

    Without a reduction power is not changed. Scans that cannot be read, and those of another size than the first, are
    left out. `progress` is called with (drives made, drives to make). DataError for a drive that cannot be read or a
    folder that cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for partial in folder.glob(f'*{_PARTIAL}'):
            if partial.name.split('.')[0].isdigit() and not Path('/proc', partial.name.split('.')[0]).exists():
                shutil.rmtree(partial, ignore_errors=True)
        paths = [_path(folder, source, reduction) for source in sources]
        missing = {path: source for source, path in zip(sources, paths, strict=True) if not path.is_file()}
        parallel_map(_make, [(source, path, reduction) for path, source in missing.items()], processes, progress)
        return [_read(path) for path in paths]
    except OSError as error:
        raise DataError(f'{folder}: the cache cannot be written or read ({error.strerror or error})') from error


def _path(folder: Path, source: DriveSource, reduction: Reduction | None) -> Path:
    digest = hashlib.sha256(json.dumps(_settings(source, reduction), sort_keys=True).encode()).hexdigest()
    return folder / f'{source.name}-{digest[:16]}.json'


def _settings(source: DriveSource, reduction: Reduction | None) -> dict[str, Any]:
    return {
        'offradar_ros': __version__,
        'form': _FORM,
        'kind': type(source).__name__,
        'drive': source.settings(),
        'reduction': reduction and dataclasses.asdict(reduction),
    }


def _make(source: DriveSource, path: Path, reduction: Reduction | None) -> None:
    """Write one drive's files."""
    drive = source.open()
    # Of this process, so that the next run finds what a killed one left; nobody else may guess its name or write in it.
    own = Path(tempfile.mkdtemp(prefix=f'{os.getpid()}.', suffix=_PARTIAL, dir=path.parent))
    try:
        with whole_file(own / 'power.npy') as file:
            first, rows, offsets_ns = _write_power(drive, reduction, file)
        if first is None:
            raise DataError(f'{source.name}: none of its scans can be read')
        (own / 'power.npy').replace(path.with_suffix('.npy'))
    finally:
        shutil.rmtree(own, ignore_errors=True)
    header = {
        **_settings(source, reduction),
        'name': drive.name,
        'world': drive.world,
        'layout': drive.layout,
        'left_out': len(drive) - len(rows),
        'azimuths_rad': first.azimuths_rad.tolist(),
        'range_resolution_m': first.range_resolution_m,
        'range_offset_m': first.range_offset_m,
        'row_offsets_ns': offsets_ns,
        **{name: getattr(drive, name)[rows].tolist() for name in COLUMNS},
    }
    write_whole_file(path, json.dumps(header).encode())


def _write_power(
    drive: Drive, reduction: Reduction | None, file: BinaryIO
) -> tuple[PolarScan | None, list[int], list[int]]:
    """Write the power of all scans that can be read as NPY; the first of them, the indices of all, and offsets.

    The offsets are nanoseconds from the stamp of the first scan to those of its rows: empty if they are unknown, or if
    another scan turned otherwise.

    A full disk is an error of the call that writes, which it would not be for memory that is mapped.
    """
    rows: list[int] = []
    offsets_ns: NDArray[np.int64] | None = None
    first: PolarScan | None = None
    for row in range(len(drive)):
        try:
            scan = drive.scan(row)
        except (DataError, RefusedInput):
            continue
        scan = at_azimuths(scan, np.sort(scan.azimuths_rad) if first is None else first.azimuths_rad)
        if reduction:
            scan = reduction(scan)
        if first is None:
            first, offsets_ns = scan, _row_offsets_ns(scan)
            shape = (len(drive), *scan.power.shape)
            np.lib.format.write_array_header_1_0(file, {'descr': '|u1', 'fortran_order': False, 'shape': shape})
            end = file.tell() + math.prod(shape)
        elif _size(scan) != _size(first):
            continue
        own_ns = _row_offsets_ns(scan)
        if own_ns is None or (offsets_ns is not None and np.abs(own_ns - offsets_ns).max() > _MOST_APART_NS):
            offsets_ns = None
        file.write(np.ascontiguousarray(scan.power).tobytes())
        rows.append(row)
    if first is not None:
        # Scans that were left out are zeros at the end.
        file.truncate(end)
    return first, rows, [] if offsets_ns is None else offsets_ns.tolist()


def _row_offsets_ns(scan: PolarScan) -> NDArray[np.int64] | None:
    return None if scan.azimuth_stamps_ns is None else scan.azimuth_stamps_ns - scan.stamp_ns


def _size(scan: PolarScan) -> tuple[tuple[int, ...], float, float]:
    return scan.power.shape, scan.range_resolution_m, scan.range_offset_m


def _read(path: Path) -> Drive:
    try:
        header = parse_json(read_bounded(path, _LARGEST_HEADER), _LARGEST_HEADER)
        power = map_array(path.with_suffix('.npy'))
        azimuths_rad = np.array(header['azimuths_rad'], np.float64)
        resolution_m, offset_m = float(header['range_resolution_m']), float(header['range_offset_m'])
        offsets_ns = np.array(header['row_offsets_ns'], np.int64)
        columns = {name: np.array(header[name], dtype) for name, dtype in COLUMNS.items()}
        name, world, layout = header['name'], header['world'], header['layout']
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise DataError(f'{path}: damaged cached drive ({error}): remove it to make it again') from None
    stamps_ns, poses, driven_m, kinds, severities = columns.values()
    if {len(column) for column in columns.values()} != {len(stamps_ns)} or len(power) < len(stamps_ns):
        raise DataError(f'{path}: its files do not belong together: remove it to make it again')

    def read_scan(row: int) -> PolarScan:
        stamp_ns = int(stamps_ns[row])
        rows_ns = stamp_ns + offsets_ns if len(offsets_ns) else None
        return PolarScan(stamp_ns, np.array(power[row]), azimuths_rad, resolution_m, offset_m, rows_ns)

    return Drive(name, world, path.stem, stamps_ns, poses, driven_m, kinds, severities, read_scan, layout)
