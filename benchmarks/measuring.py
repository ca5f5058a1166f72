"""Timings, the description of the machine, and results as JSON.

Times are wall clock. Functions that are compared are called in turn in one run, so that other load on the machine
affects all of them alike.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import platform
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from offradar_ros.lab.evaluation.results.provenance import processor, versions

ROOT = Path(__file__).resolve().parents[1]
MAKERS = ('drives.py', 'sample_networks.py', 'sample_signatures.py', 'synthetic_maps.py')

PACKAGES = (
    'numpy',
    'scipy',
    'opencv-python-headless',
    'onnxruntime',
    'torch',
    'rosbags',
    'ros-jazzy-rclpy',
    'faiss-cpu',
)
INTEGERS = ('avx512_vnni', 'avx_vnni', 'amx_int8')
"""CPU flags of instructions that multiply and add 8-bit integers."""
THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


@dataclasses.dataclass(frozen=True)
class Timing:
    """Wall clock times of one function in milliseconds: median, quartiles and 99th percentile."""

    median_ms: float
    quartiles_ms: tuple[float, float]
    p99_ms: float
    repeats: int

    @classmethod
    def of(cls, seconds: list[float]) -> Timing:
        """The timing of single calls, from their seconds; ValueError without calls."""
        if not seconds:
            raise ValueError('a timing of no calls')
        low, median, high, p99 = (float(v) for v in np.quantile(seconds, (0.25, 0.5, 0.75, 0.99)) * 1e3)
        return cls(median, (low, high), p99, len(seconds))

    def as_dict(self) -> dict[str, Any]:
        """The attributes for JSON, with four significant digits."""
        low, high = self.quartiles_ms
        return {
            'median_ms': rounded(self.median_ms),
            'quartiles_ms': [rounded(low), rounded(high)],
            'p99_ms': rounded(self.p99_ms),
            'repeats': self.repeats,
        }


def interleaved(
    functions: Mapping[str, Callable[[], object]], repeats: int = 50, warm_up: int = 3, seconds: float = 60.0
) -> dict[str, Timing]:
    """Time each function `repeats` times, calling all of them in turn; no round starts after `seconds`.

    `warm_up` rounds before are not counted. At least one round is timed.
    """
    for _ in range(warm_up):
        for function in functions.values():
            function()
    taken: dict[str, list[float]] = {name: [] for name in functions}
    end_s = time.perf_counter() + seconds
    for round_ in range(repeats):
        if round_ and time.perf_counter() > end_s:
            break
        for name, function in functions.items():
            start_s = time.perf_counter()
            function()
            taken[name].append(time.perf_counter() - start_s)
    return {name: Timing.of(calls) for name, calls in taken.items()}


def machine() -> dict[str, Any]:
    """Processor, cores that this process may use, memory and system."""
    known = Path('/proc/cpuinfo')
    flags = set(known.read_text(encoding='utf-8').split()) if known.is_file() else set()
    return {
        'processor': processor(),
        'architecture': platform.machine(),
        'cores': len(os.sched_getaffinity(0)),
        'integers': [flag for flag in INTEGERS if flag in flags],
        'memory_gib': round(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30, 1),
        'system': f'{platform.system()} {platform.release()}',
    }


def previous_results(path: Path) -> dict[str, Any]:
    """The results in the file `path` if this machine and these versions made them; otherwise nothing."""
    if not path.is_file():
        return {}
    record: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    if (record.get('machine'), record.get('versions')) != (machine(), versions(PACKAGES)):
        print(f'{path}: of another machine or other versions: its results are not kept')
        return {}
    return record


def cache_folder(folder: Path) -> Path:
    """A folder in `folder` for drives, networks and maps made by the present code; those of other code are removed."""
    sources = sorted([*(ROOT / 'offradar_ros').rglob('*.py'), *(ROOT / 'benchmarks' / name for name in MAKERS)])
    digest = hashlib.sha256(b''.join(path.read_bytes() for path in sources)).hexdigest()[:12]
    made = folder.resolve() / f'made_by_{digest}'
    for other in set(folder.glob('made_by_*')) - {folder / made.name}:
        shutil.rmtree(other)
    made.mkdir(parents=True, exist_ok=True)
    return made


def single_threaded() -> None:
    """Start this script again with one BLAS thread, as the nodes have, because NumPy is already loaded."""
    if any(os.environ.get(name) != '1' for name in THREADS):
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | dict.fromkeys(THREADS, '1'))


def write_results(
    path: Path,
    results: Mapping[str, Any],
    seeds: Mapping[str, int] | None = None,
    kept: Mapping[str, Any] | None = None,
) -> None:
    """Write `results` as JSON, with the machine, the versions and the commands, those of `kept` first."""
    record = {
        'commands': [*(kept or {}).get('commands', []), portable_command(['python', *sys.argv])],
        'machine': machine(),
        'versions': versions(PACKAGES),
        'threads': {name: os.environ[name] for name in THREADS if name in os.environ},
        'seeds': dict(seeds or {}),
        **results,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record, indent=1, ensure_ascii=False) + '\n', encoding='utf-8')


def rounded(value: float, digits: int = 4) -> float:
    """The value with `digits` significant digits."""
    return float(f'{value:.{digits}g}')


def portable_command(words: Sequence[str]) -> str:
    """A command line in which paths, also those in `NAME=PATH`, are relative to the project, or a bare file name."""
    return shlex.join(map(_relative, words))


def _relative(word: str) -> str:
    name, equals, path = word.rpartition('=')
    inside = path.removeprefix(f'{ROOT}{os.sep}')
    return name + equals + (Path(inside).name if inside.startswith(('/', '~', '../')) else inside)
