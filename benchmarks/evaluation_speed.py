"""Time of an evaluation with cached embeddings: 20 ordered pairs of drives of 1,500 scans each.

The drives are first rendered and encoded (with the ring key, d = 128), which is not timed. Then the whole command is
run several times in new processes, with every figure, interval and maintained map, but without pictures.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

PROTOCOL = """
name: speed
title: Twenty pairs of 1,500 scans
groups:
  - {name: city, title: One city, cities: [2600001]}
lanes:
  - {left_m: 0.0, start_m: 0.0}
  - {left_m: 3.5, start_m: 1.7}
  - {left_m: -1.5, start_m: 3.1}
  - {left_m: 1.5, start_m: 0.7}
  - {left_m: -3.5, start_m: 1.3}
scans: 1500
drive_spacing_m: 3.0
degraded: 0.35
map_spacings_m: [0.0]
validation: {cities: [2600002], scans: 100}
"""
RUNS = 3


class Ran(NamedTuple):
    """Wall clock time and peak memory of a command."""

    seconds: float
    peak_mb: float


def offradar(*words: object) -> Ran:
    """Run a command in a new process."""
    start_s = time.perf_counter()
    command = [sys.executable, '-m', 'offradar_ros.cli.main', *map(str, words)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f'{" ".join(command)}: failed')
    return Ran(time.perf_counter() - start_s, usage.ru_maxrss / 1024)


def distances_s() -> float:
    """Seconds of the 20 distance matrices alone, in double precision: a lower bound of exact search."""
    rng = np.random.default_rng(0)
    queries, places = rng.normal(size=(2, 1500, 128))
    start_s = time.perf_counter()
    for _ in range(20):
        np.square(queries).sum(1)[:, None] + np.square(places).sum(1) - 2.0 * (queries @ places.T)
    return time.perf_counter() - start_s


def main() -> None:
    """Print one JSON record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--folder', type=Path, default=Path('build/evaluation_speed'), help='for scans and results')
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    (folder / 'protocol.yaml').write_text(PROTOCOL)
    shared = (folder / 'protocol.yaml', '--method', 'ring_key', '--cache', folder / 'cache')
    offradar('encode', *shared)
    runs = [offradar('evaluate', *shared, '--out', folder / 'out', '--no-pictures') for _ in range(RUNS)]
    median_s = statistics.median(run.seconds for run in runs)
    results = json.loads((folder / 'out' / 'results.json').read_text())
    figures = results['groups']['city']['0']['ring_key']
    matrices_s = statistics.median(distances_s() for _ in range(RUNS))
    record = {
        'pairs': figures['pairs'],
        'queries': figures['queries'],
        'places_a_map': figures['places'],
        'seconds': [round(run.seconds, 2) for run in runs],
        'median_s': round(median_s, 2),
        'ratio_to_the_distance_matrices': round(median_s / matrices_s, 1),
        'peak_memory_mb': round(max(run.peak_mb for run in runs)),
        'cores': len(os.sched_getaffinity(0)),
        'machine': platform.processor() or platform.machine(),
        'python': platform.python_version(),
        'numpy': np.__version__,
    }
    print(json.dumps(record, indent=1))


if __name__ == '__main__':
    main()
