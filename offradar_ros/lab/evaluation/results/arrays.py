"""The arrays of an evaluation: a row for each query scan, and maps before and after maintenance."""

from __future__ import annotations

import io
import itertools
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.model_files import write_atomically
from offradar_ros.errors import DataError, ModelError
from offradar_ros.lab.array_file import read_array, write_array
from offradar_ros.lab.evaluation.results.searches import MaintainedMap, Search
from offradar_ros.lab.evaluation.runner import Measured, Worlds, drives_of_pair

_LARGEST_MAPS = 4 * 1024**3

SCANS_FILE, MAPS_FILE = 'scans.npy', 'maps.npz'
"""File names in the folder of an evaluation."""

SCANS = np.dtype(
    [
        ('pair', '<i4'),
        ('scan', '<i4'),
        ('uncertainty', '<f8'),
        ('rank', '<i4'),
        ('positive', '?'),
        ('severity', '<f4'),
        ('kind', '<i1'),
        ('error_m', '<f4'),
        ('distance', '<f4'),
        ('p_right', '<f8'),
        ('answered', '?'),
        ('x_m', '<f8'),
        ('y_m', '<f8'),
    ]
)
"""Row of ``scans.npy``: `pair` is an index of the results' `searches` and `kind` of their `kinds`; `x_m` and `y_m` are
where the scan was taken, in the frame of the world; `p_right` is NaN where it is unknown, and `answered` what the gate
in use decides, of unmaintained maps only; the other columns are as in `Answers`."""


class ScanRows(NamedTuple):
    """(R,) rows of type `SCANS`, and the lists that their indices refer to."""

    rows: NDArray[Any]
    searches: tuple[Search, ...]
    kinds: tuple[str, ...]


class MapArrays(NamedTuple):
    """Arrays ``before_K`` and ``after_K``, (P, 3) float64 x and y in metres and U; K is an index of `maps`."""

    arrays: dict[str, NDArray[np.float64]]
    maps: tuple[MaintainedMap, ...]


def scan_rows(measured: Sequence[Measured], worlds: Worlds) -> ScanRows:
    """A row for each query scan of each search: in all unmaintained maps, then in all maintained ones."""
    several = [(answers, False, m.gate) for m in measured for answers in m.answers]
    several += [(a.maintained, True, m.gate) for m in measured for found in m.ablations.values() for a in found]
    kinds = sorted({kind for answers, _, _ in several for kind in answers.kinds.tolist()})
    parts = []
    for number, (answers, maintained, gate) in enumerate(several):
        part = np.zeros(len(answers.ranks), SCANS)
        part['pair'], part['scan'] = number, np.arange(len(part))
        part['uncertainty'], part['rank'], part['positive'] = answers.uncertainties, answers.ranks, answers.positive
        part['severity'], part['kind'] = answers.severities, np.searchsorted(kinds, answers.kinds)
        part['error_m'], part['distance'] = answers.errors_m, answers.distances
        part['p_right'], part['answered'] = gate.p_right(answers), gate.answered(answers) & (not maintained)
        poses = drives_of_pair(answers.pair, worlds)[1].poses
        part['x_m'], part['y_m'] = poses[:, 0], poses[:, 1]
        parts.append(part)
    searches = tuple(Search(answers.pair, maintained) for answers, maintained, _ in several)
    return ScanRows(np.concatenate(parts), searches, tuple(kinds))


def map_arrays(measured: Sequence[Measured]) -> MapArrays:
    """The map of the first ordered pair of each method, world and spacing, before and after maintenance."""
    arrays: dict[str, NDArray[np.float64]] = {}
    maps: list[MaintainedMap] = []
    seen = set()
    for m in measured:
        for ablation in itertools.chain.from_iterable(m.ablations.values()):
            pair = ablation.unmaintained.pair
            if (pair.method, pair.group, pair.world, pair.spacing_m) in seen:
                continue
            seen.add((pair.method, pair.group, pair.world, pair.spacing_m))
            arrays[f'before_{len(maps)}'], arrays[f'after_{len(maps)}'] = ablation.before, ablation.after
            maps.append(MaintainedMap(pair, ablation.opportunities, ablation.replaced))
    return MapArrays(arrays, tuple(maps))


def write_arrays(folder: Path, rows: NDArray[Any], arrays: dict[str, NDArray[np.float64]]) -> None:
    """Write scans.npy and maps.npz, each atomically; ModelError if they cannot be written."""
    try:
        write_array(folder / SCANS_FILE, rows)
    except OSError as error:
        raise ModelError(f'{folder / SCANS_FILE}: cannot be written ({error.strerror or error})') from error
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **arrays)
    write_atomically(folder / MAPS_FILE, file.getvalue())


def read_arrays(folder: Path) -> tuple[NDArray[Any], dict[str, NDArray[np.float64]]]:
    """The arrays that `write_arrays` wrote; DataError if a file is missing or damaged."""
    try:
        rows = read_array(folder / SCANS_FILE)
        with np.load(folder / MAPS_FILE, allow_pickle=False) as stored:
            inflated = sum(part.file_size for part in stored.zip.infolist())
            if inflated > _LARGEST_MAPS:
                raise ValueError(f'{inflated} bytes of maps')
            return rows, {name: stored[name] for name in stored.files}
    # MemoryError: a header claims an array larger than the memory.
    except (OSError, ValueError, EOFError, KeyError, MemoryError, zipfile.BadZipFile) as error:
        raise DataError(f'{folder}: expected {SCANS_FILE} and {MAPS_FILE} of offradar evaluate ({error})') from None
