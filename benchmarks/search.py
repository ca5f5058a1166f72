"""Time and memory of searching, merging into and opening a map of a thousand to a million places.

README.md explains each figure. Each part can be run alone: the results of the others are kept.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from machine_peaks import gigaflops, readings
from measuring import ROOT, Timing, cache_folder, interleaved, previous_results, rounded, single_threaded, write_results
from numpy.typing import NDArray
from search_plot import draw
from synthetic_maps import DIMENSION, MODEL, SPACING_M, map_file, near_some, synthetic_table

from offradar_ros.config import MapConfig
from offradar_ros.lab.live.process_usage import process_usage
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Embedding, PlaceTable, Pose

SIZES = (1_000, 10_000, 100_000, 1_000_000)
TOP_K = (1, 5, 25, 100, 1000)
SEED = 7
PEER_K = 25
OPENINGS = 3
MERGES = 1000


def main() -> None:
    """Measure the given parts, then draw all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('parts', nargs='*', help=f'some of {", ".join(PARTS)} (default: all)')
    parser.add_argument('--folder', type=Path, default=ROOT / 'build' / 'bench', help='for map files, 0.7 GB')
    parser.add_argument(
        '--out',
        type=Path,
        default=ROOT / 'benchmarks' / 'results' / 'search.json',
        help='default: the results in the repository',
    )
    parser.add_argument(
        '--picture', type=Path, default=ROOT / 'docs' / 'search_cost.png', help='default: the one in docs'
    )
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(PARTS):
        parser.error(f'no such part: {", ".join(sorted(unknown))}')
    kept = previous_results(arguments.out) if arguments.parts else {}
    results = dict(kept)
    for part in arguments.parts or PARTS:
        results[part] = PARTS[part](cache_folder(arguments.folder))
    write_results(arguments.out, {part: results[part] for part in PARTS if part in results}, {'maps': SEED}, kept)
    if len(set(PARTS) & set(results)) == len(PARTS):
        draw(results, arguments.picture)


def measure_search(_: Path) -> dict[str, Any]:
    """Time of queries for every top-k, called in turn with reading the matrix."""
    peak = gigaflops()
    found: dict[str, Any] = {'dimension': DIMENSION, 'peak_gflops': rounded(peak), 'sizes': {}}
    for places in SIZES:
        print(f'search: {places} places', flush=True)
        found['sizes'][str(places)] = _searched(synthetic_table(places, SEED), peak)
    return found


def _searched(table: PlaceTable, peak: float) -> dict[str, Any]:
    queries = near_some(table.means, 64, SEED + 1)
    index = PlaceIndex(DIMENSION, len(table))
    index.upsert(table)
    functions: dict[str, Callable[[], object]] = {f'query, {k}': _searching(index, queries, k) for k in TOP_K}
    functions |= {f'reading, {name}': read for name, read in readings(table.means).items()}
    functions |= _peers(table.means, queries)
    taken = interleaved(functions, repeats=200, warm_up=3, seconds=30.0)
    reads = {name.removeprefix('reading, '): t for name, t in taken.items() if name.startswith('reading, ')}
    fastest = min(reads, key=lambda name: reads[name].median_ms)
    read_ms, size = reads[fastest].median_ms, table.means.nbytes
    return {
        'matrix_bytes': size,
        'reading': {'way': fastest, 'gb_s': rounded(size / read_ms / 1e6), **reads[fastest].as_dict()},
        'queries': {str(k): taken[f'query, {k}'].as_dict() for k in TOP_K},
        'ratio_to_reading': {str(k): rounded(taken[f'query, {k}'].median_ms / read_ms, 3) for k in TOP_K},
        'peers': {name: t.as_dict() for name, t in taken.items() if name.startswith('faiss')},
        'flop_floor_ms': rounded(2e-6 * table.means.size / peak),
    }


def _searching(index: PlaceIndex, queries: NDArray[np.float32], k: int) -> Callable[[], object]:
    following = _in_turn(queries)
    return lambda: index.search(next(following), k)


def _in_turn(queries: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    while True:
        yield from queries


def _peers(means: NDArray[np.float32], queries: NDArray[np.float32]) -> dict[str, Callable[[], object]]:
    """Queries of faiss, if it is installed."""
    try:
        faiss = importlib.import_module('faiss')
    except ImportError:
        return {}
    faiss.omp_set_num_threads(1)
    index = faiss.IndexFlatL2(DIMENSION)
    index.add(means)
    following = _in_turn(queries)
    return {f'faiss flat, {PEER_K}': lambda: index.search(next(following)[None], PEER_K)}


def measure_merge(folder: Path) -> dict[str, Any]:
    """Time of merging one scan into a session map and of collecting the changed rows, as in the map server."""
    record: dict[str, Any] = {}
    for places in SIZES:
        print(f'merge: {places} places', flush=True)
        path = map_file(folder, places, SEED)
        # The session is never ended, so that the file does not change.
        with SessionMap(MapConfig(path=str(path))) as session_map:
            session_map.start_session('merges', 1)
            record[str(places)] = _merged(session_map, synthetic_table(places, SEED))
    return record


def _merged(session_map: SessionMap, table: PlaceTable) -> dict[str, Any]:
    rng = np.random.default_rng(SEED + 2)
    # No place is used twice; its U is 1.
    rows = rng.permutation(len(table))
    half = min(MERGES, len(table) // 2)
    beside = table.positions_m[:, :2] + 1.0
    cases = {
        'inserted': (1.0, np.stack([np.full(MERGES, -1000.0), SPACING_M * np.arange(MERGES)], axis=1)),
        'replaced': (0.5, beside[rows[:half]]),
        'kept': (2.0, beside[rows[half : 2 * half]]),
    }
    record: dict[str, Any] = {}
    for kind, (uncertainty, positions_m) in cases.items():
        wall_s, cpu_s = [], []
        for stamp, (x_m, y_m) in enumerate(positions_m.tolist(), start=10**9):
            mean = rng.standard_normal(DIMENSION).astype(np.float32)
            scan = Embedding(stamp, mean, np.full(DIMENSION, uncertainty, np.float32), MODEL.fingerprint)
            start_s, start_cpu_s = time.perf_counter(), time.thread_time()
            merge = session_map.merge(scan, Pose(x_m, y_m))
            session_map.changed(merge)
            wall_s.append(time.perf_counter() - start_s)
            cpu_s.append(time.thread_time() - start_cpu_s)
            if merge.kind.value != kind:
                raise SystemExit(f'expected a scan to be {kind}, it was {merge.kind.value}')
        record[kind] = Timing.of(wall_s).as_dict() | {'cpu_p99_ms': Timing.of(cpu_s).as_dict()['p99_ms']}
    return record


def measure_opening(folder: Path) -> dict[str, Any]:
    """Time and memory of a process that opens a map, compared with one that opens an empty map."""
    record: dict[str, Any] = {}
    empty = {who: _opened(map_file(folder, 0, SEED), who) for who in OPENERS}
    for places in SIZES:
        path = map_file(folder, places, SEED)
        matrix = 4 * DIMENSION * places
        for who in OPENERS:
            print(f'opening: {places} places, {who}', flush=True)
            _read(path)
            warm = [_opened(path, who) for _ in range(OPENINGS)]
            cold = _opened(path, who, cold=True)
            held = statistics.median(run['rss'] for run in warm) - empty[who]['rss']
            peak = statistics.median(run['peak'] for run in warm) - empty[who]['rss']
            record.setdefault(str(places), {})[who] = {
                'seconds': [rounded(run['seconds'], 3) for run in warm],
                'cpu_seconds': [rounded(run['cpu_seconds'], 3) for run in warm],
                'cold_seconds': rounded(cold['seconds'], 3),
                'resident_bytes': statistics.median(run['rss'] for run in warm),
                'memory_bytes': held,
                'memory_to_matrix': rounded(held / matrix, 3),
                'peak_to_matrix': rounded(peak / matrix, 3),
            }
    return record


def _read(path: Path) -> None:
    """Read a file, so that it is in the page cache."""
    with path.open('rb') as file:
        while file.read(2**24):
            pass


def _opened(path: Path, who: str, cold: bool = False) -> dict[str, float]:
    if cold:
        with path.open('rb') as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    command = [sys.executable, __file__, '--open', who, str(path)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=300)
    record: dict[str, float] = json.loads(done.stdout)
    return record


def open_and_print(who: str, path: Path) -> None:
    """Open a map in this new process, use it once, and print the time and memory."""
    start_s, start_cpu_s = time.perf_counter(), time.process_time()
    held = OPENERS[who](path)
    seconds, cpu_seconds = time.perf_counter() - start_s, time.process_time() - start_cpu_s
    if isinstance(held, SearchedMap):
        mean = np.full(DIMENSION, 0.1, np.float32)
        held.nearest(Embedding(1, mean, np.ones(DIMENSION, np.float32), MODEL.fingerprint), 5)
    used = process_usage(os.getpid())
    record = {'seconds': seconds, 'cpu_seconds': cpu_seconds, 'rss': used.resident_bytes, 'peak': used.peak_bytes}
    print(json.dumps(record))


def _searched_map(path: Path) -> SearchedMap:
    searched = SearchedMap()
    searched.load_file(path)
    return searched


OPENERS: dict[str, Callable[[Path], object]] = {
    'query': _searched_map,
    'map server': lambda path: SessionMap(MapConfig(path=str(path))),
}
PARTS: dict[str, Callable[[Path], dict[str, Any]]] = {
    'search': measure_search,
    'merge': measure_merge,
    'opening': measure_opening,
}

if __name__ == '__main__':
    single_threaded()
    if sys.argv[1:2] == ['--open']:
        open_and_print(sys.argv[2], Path(sys.argv[3]))
    else:
        main()
