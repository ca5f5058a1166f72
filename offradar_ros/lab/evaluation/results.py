"""The one JSON file of an evaluation: every figure, and all that is needed to measure it again."""

from __future__ import annotations

import dataclasses
import datetime
import importlib.metadata
import io
import itertools
import json
import math
import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros import __version__
from offradar_ros.encoders.model_files import write_atomically
from offradar_ros.errors import DataError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.introspection import summarise_ablation
from offradar_ros.lab.evaluation.protocol import ALL, VALIDATION, Protocol
from offradar_ros.lab.evaluation.runner import Measured, Worlds, drives_of_pair
from offradar_ros.lab.evaluation.summary import Json, describe_uncertainty, summarise
from offradar_ros.recordings.datasets.splits import read_split

FORMAT = 'offradar-evaluation-2'
RESULTS_FILE, SCANS_FILE, MAPS_FILE = 'results.json', 'scans.npy', 'maps.npz'
"""What an evaluation leaves in its folder, beside pictures."""

PACKAGES = ('numpy', 'opencv-python-headless', 'torch', 'onnxruntime', 'safetensors')

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
        ('x_m', '<f8'),
        ('y_m', '<f8'),
    ]
)
"""Row of ``scans.npy``: `pair` counts into the results' `pairs`, `kind` into their `kinds`, x and y are where the scan
was taken; the rest as `Answers`."""


def spacing_key(spacing_m: float) -> str:
    """Name under which results keep figures of maps with a place every so many metres."""
    return f'{spacing_m:g}'


def assemble(
    measured: Sequence[Measured], worlds: Worlds, protocol: Protocol, command: str, skipped: Sequence[str]
) -> Json:
    """Everything but the targets and the recorded scans; NaN becomes null when it is written."""
    told = dataclasses.asdict(protocol)
    for group in told['groups']:
        for road in group['recorded']:
            road['source'] = read_split(road['split']).source if road['split'] else ''
    groups = [g.name for g in protocol.groups if any(a.pair.group == g.name for m in measured for a in m.answers)]
    return {
        'format': FORMAT,
        'created': datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'),
        'command': command,
        'versions': versions(),
        'protocol': told,
        'worlds': sorted({a.pair.world for m in measured for a in m.answers}),
        'scans': {g.name: g.scans for g in protocol.groups},
        'drives': {f'{group}/{world}': list(map(_drive, drives)) for (group, world), drives in worlds.items()},
        'machine': {'processor': processor(), 'cores': len(os.sched_getaffinity(0))},
        'seeds': _seeds(protocol),
        'skipped': list(skipped),
        'methods': {m.method: _method(m) for m in measured},
        'groups': {group: _by_spacing(measured, protocol, _of_group(group)) for group in [*groups, ALL]},
        'uncertainty': {
            group: {m.method: describe_uncertainty(list(filter(_of_group(group), m.answers))) for m in measured}
            for group in [*groups, ALL]
        },
        'maintenance': {group: _maintenance(measured, protocol, group) for group in [*groups, ALL]},
    }


def _drive(drive: Drive) -> Json:
    roles = ' and '.join(word for word, so in (('mapped', drive.mapped), ('searched', drive.queried)) if so)
    roles = 'validation' if drive.group == VALIDATION else roles
    way_m = float(drive.driven_m[-1] - drive.driven_m[0])
    return {'index': drive.index, 'name': drive.name, 'scans': len(drive), 'way_m': way_m, 'roles': roles}


def processor() -> str:
    """As Linux names it."""
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Of the project, Python and the packages that figures depend on; those installed."""
    found = {'offradar_ros': __version__, 'python': platform.python_version()}
    for package in packages:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def scan_rows(measured: Sequence[Measured], worlds: Worlds) -> tuple[NDArray[Any], list[Json], list[str]]:
    """One row of `SCANS` for every query scan, and the pairs and kinds that they count into.

    Of maps as they were made, and then of maintained ones, whose pairs say so.
    """
    several = [(answers, False) for m in measured for answers in m.answers]
    several += [(a.maintained, True) for m in measured for told in m.ablations.values() for a in told]
    kinds = sorted({kind for answers, _ in several for kind in answers.kinds.tolist()})
    parts = []
    for number, (answers, _) in enumerate(several):
        part = np.zeros(len(answers.ranks), SCANS)
        part['pair'], part['scan'] = number, np.arange(len(part))
        part['uncertainty'], part['rank'], part['positive'] = answers.uncertainties, answers.ranks, answers.positive
        part['severity'], part['kind'] = answers.severities, np.searchsorted(kinds, answers.kinds)
        part['error_m'], part['distance'] = answers.errors_m, answers.distances
        poses = drives_of_pair(answers.pair, worlds)[1].poses
        part['x_m'], part['y_m'] = poses[:, 0], poses[:, 1]
        parts.append(part)
    pairs = [{**dataclasses.asdict(answers.pair), 'maintained': maintained} for answers, maintained in several]
    return np.concatenate(parts), pairs, kinds


def map_arrays(measured: Sequence[Measured]) -> tuple[dict[str, NDArray[np.float64]], list[Json]]:
    """The first ordered pair of each world, before and after its map was maintained, as `Ablation` has it.

    Arrays ``before_K`` and ``after_K``, (P, 3) x, y, U, of the K-th pair in the list.
    """
    arrays: dict[str, NDArray[np.float64]] = {}
    listed: list[Json] = []
    seen = set()
    for m in measured:
        for ablation in itertools.chain.from_iterable(m.ablations.values()):
            pair = ablation.unmaintained.pair
            if (pair.method, pair.group, pair.world, pair.spacing_m) in seen:
                continue
            seen.add((pair.method, pair.group, pair.world, pair.spacing_m))
            arrays[f'before_{len(listed)}'], arrays[f'after_{len(listed)}'] = ablation.before, ablation.after
            counts = {'opportunities': ablation.opportunities, 'replaced': ablation.replaced}
            listed.append(dataclasses.asdict(pair) | counts)
    return arrays, listed


def write_arrays(folder: Path, rows: NDArray[Any], maps: dict[str, NDArray[np.float64]]) -> None:
    """scans.npy and maps.npz, each whole or not at all; ModelError where they cannot be written."""
    file = io.BytesIO()
    np.save(file, rows, allow_pickle=False)
    write_atomically(folder / SCANS_FILE, file.getvalue())
    file = io.BytesIO()
    np.savez_compressed(file, allow_pickle=False, **maps)
    write_atomically(folder / MAPS_FILE, file.getvalue())


def write_results(path: Path, results: Json) -> None:
    """JSON without NaN; ModelError where it cannot be written."""
    write_atomically(path, (json.dumps(_plain(results), indent=1, allow_nan=False) + '\n').encode())


def read_results(path: str | Path) -> Json:
    """What `write_results` wrote; DataError for anything else."""
    try:
        results = json.loads(Path(path).read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        raise DataError(f'{path}: expected the results.json of offradar evaluate ({error})') from None
    if not isinstance(results, dict) or results.get('format') != FORMAT:
        raise DataError(f'{path}: expected the results.json of offradar evaluate, format {FORMAT}')
    lacks = [key for key in ('protocol', 'methods', 'groups', 'uncertainty', 'maintenance') if key not in results]
    if lacks:
        raise DataError(f'{path}: damaged: without {", ".join(lacks)}')
    return results


def _method(measured: Measured) -> Json:
    info = measured.model
    return {
        'encoder': info.name,
        'fingerprint': info.fingerprint,
        'dimension': info.dimension,
        'weights': Path(measured.weights).name,
        'settings': dict(info.metadata),
        'fitted_to_each_map': measured.fitted,
        'thresholds': measured.thresholds._asdict(),
        'cost': measured.cost,
    }


def _of_group(group: str) -> Callable[[Answers], bool]:
    return lambda answers: group in (ALL, answers.pair.group)


def _by_spacing(measured: Sequence[Measured], protocol: Protocol, chosen: Callable[[Answers], bool]) -> Json:
    return {
        spacing_key(spacing_m): {
            m.method: summarise(
                [a for a in m.answers if chosen(a) and a.pair.spacing_m == spacing_m], protocol, m.thresholds
            )
            for m in measured
        }
        for spacing_m in protocol.map_spacings_m
    }


def _maintenance(measured: Sequence[Measured], protocol: Protocol, group: str) -> Json:
    found: Json = {}
    for spacing_m in protocol.map_spacings_m:
        told = found[spacing_key(spacing_m)] = {}
        for m in measured:
            keys = [key for key in m.ablations if group in (ALL, key[0]) and key[1] == spacing_m]
            several = [ablation for key in keys for ablation in m.ablations[key]]
            if several:
                told[m.method] = summarise_ablation(several, m.thresholds.deployed, protocol)
    return found


def _seeds(protocol: Protocol) -> list[int]:
    cities = [seed for group in protocol.groups for seed in group.cities]
    streets = [street.seed for group in protocol.groups for street in group.streets]
    return [*cities, *streets, *protocol.validation.cities, protocol.seed]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
