"""What signatures cost: making one, and memory, file and time of a map of 10,000 places that has them.

README.md explains each figure.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from measuring import ROOT, interleaved, rounded, single_threaded, write_results
from sample_signatures import packed_turns
from scan_sources import REAL, announce_machine, scan_sources
from synthetic_maps import DIMENSION, MODEL, synthetic_table

from offradar_ros.alignment.signature import Signature, SignatureMaker
from offradar_ros.alignment.signature_code import pack, unpack
from offradar_ros.config import MapConfig
from offradar_ros.lab.live.process_usage import process_usage
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.signature_file import SignatureFile
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Embedding, PolarScan, Pose, ScanKey

PLACES = 10_000
SCANS = 20
CANDIDATES = 5
REPLACED = 100
"""Scans of a later session."""
OPENINGS = 5
SEED = 7


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--real', type=Path, default=REAL, metavar='FOLDER', help=f'recorded scans (default {REAL})')
    parser.add_argument('--out', type=Path, default=ROOT / 'benchmarks' / 'results' / 'signatures.json')
    arguments = parser.parse_args()
    announce_machine()
    making: dict[str, Any] = {}
    kinds: dict[str, list[Signature]] = {'simulated': [], 'recorded': []}
    for name, scans in scan_sources(arguments.real, SCANS):
        making[name] = made(scans)
        print(f'{name}: {making[name]}', flush=True)
        kinds['simulated' if name.startswith('simulated') else 'recorded'] += map(SignatureMaker(), scans)
    maps: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / 'none.db'
        write_map(plain, itertools.repeat(b''))
        for kind, signatures in kinds.items():
            if signatures:
                path = Path(folder) / f'{kind}.db'
                write_map(path, map(packed_turns(signatures, PLACES).__getitem__, range(PLACES)))
                maps[kind] = costs(path, plain)
                print(f'{kind}: {json.dumps(maps[kind], indent=1)}', flush=True)
    write_results(arguments.out, {'places': PLACES, 'making': making, 'maps': maps}, {'means': SEED})


def made(scans: Sequence[PolarScan]) -> dict[str, Any]:
    """Bytes of packed signatures, and the time to make and pack one, and to unpack it."""
    maker = SignatureMaker()
    packed = [pack(maker(scan)) for scan in scans]
    following, contents = itertools.cycle(scans), itertools.cycle(packed)
    taken = interleaved(
        {'make': lambda: pack(maker(next(following))), 'unpack': lambda: unpack(next(contents))}, repeats=200
    )
    sizes = [len(content) for content in packed]
    return {
        'rows_and_bins': list(scans[0].power.shape),
        'bytes': {'least': min(sizes), 'median': statistics.median(sizes), 'most': max(sizes)},
        **{name: timing.as_dict() for name, timing in taken.items()},
    }


def write_map(path: Path, signatures: Any) -> None:
    """A map of one session, a place for each signature."""
    table = synthetic_table(PLACES, SEED)
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('first', 1)
        for row, signature in zip(range(PLACES), signatures, strict=False):
            session_map.merge(embedding(row + 1, 1.0, table.means[row], signature), pose(table.positions_m[row]))
        session_map.end_session()


def embedding(stamp: int, uncertainty: float, mean: Any, signature: bytes) -> Embedding:
    """A scan of the synthetic model."""
    return Embedding(stamp, mean, np.full(DIMENSION, uncertainty, np.float32), MODEL.fingerprint, signature)


def pose(position_m: Any) -> Pose:
    """At a place of the map."""
    return Pose(*position_m.tolist())


def costs(path: Path, plain: Path) -> dict[str, Any]:
    """File, memory, opening, reading and writing, compared with the map without signatures."""
    with SessionMap(MapConfig(path=str(path))) as session_map:
        scans = [ScanKey(1, row + 1) for row in range(PLACES)]
        content = session_map.signatures.read(scans)
    found: dict[str, Any] = {
        'signature_bytes': sum(map(len, content.values())),
        'file_bytes': path.stat().st_size,
        'file_bytes_without': plain.stat().st_size,
    }
    for who in OPENERS:
        runs = {name: [opened(file, who) for _ in range(OPENINGS)] for name, file in (('', path), ('_without', plain))}
        for name, of_file in runs.items():
            found.setdefault(who, {}).update(
                {
                    f'open_ms{name}': rounded(1e3 * statistics.median(run['seconds'] for run in of_file)),
                    f'resident_bytes{name}': statistics.median(run['rss'] for run in of_file),
                }
            )
    source, rng = SignatureFile(path), np.random.default_rng(SEED)

    def read_five() -> None:
        wanted = [ScanKey(1, int(stamp)) for stamp in rng.integers(1, PLACES + 1, CANDIDATES)]
        assert source.read(wanted) == {scan: content[scan] for scan in wanted}

    def open_and_read_five() -> None:
        source.close()
        read_five()

    taken = interleaved({'five': read_five, 'five_after_a_write': open_and_read_five}, repeats=500)
    found |= {name: timing.as_dict() for name, timing in taken.items()}
    found['session_ms'], found['session_ms_without'] = session_ms(path, True), session_ms(plain, False)
    return found


def session_ms(path: Path, is_signed: bool) -> dict[str, Any]:
    """Time to end a session that has replaced the scans of 100 places, over ten sessions."""
    table, rng = synthetic_table(PLACES, SEED), np.random.default_rng(SEED)
    taken = []
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(MODEL)
        for session in range(10):
            session_map.start_session('', 1)
            for row in range(session * REPLACED, (session + 1) * REPLACED):
                signature = rng.bytes(2700) if is_signed else b''
                session_map.merge(embedding(row + 1, 0.5, table.means[row], signature), pose(table.positions_m[row]))
            start_s = time.perf_counter()
            session_map.end_session()
            taken.append(time.perf_counter() - start_s)
    return {'median': rounded(1e3 * statistics.median(taken)), 'most': rounded(1e3 * max(taken))}


def opened(path: Path, who: str) -> dict[str, float]:
    """Time and memory of a new process that opens a map."""
    done = subprocess.run(
        [sys.executable, __file__, '--open', who, str(path)], stdout=subprocess.PIPE, check=True, timeout=300
    )
    record: dict[str, float] = json.loads(done.stdout)
    return record


def open_and_print(who: str, path: Path) -> None:
    """Open a map in this new process, and print the time and memory."""
    start_s = time.perf_counter()
    held = OPENERS[who](path)
    seconds, used = time.perf_counter() - start_s, process_usage(os.getpid())
    print(json.dumps({'seconds': seconds, 'rss': used.resident_bytes, 'places': len(held)}))


def searched(path: Path) -> SearchedMap:
    """As the query node reads a file."""
    found = SearchedMap()
    found.load_file(path)
    return found


OPENERS: dict[str, Callable[[Path], Any]] = {
    'query': searched,
    'map server': lambda path: SessionMap(MapConfig(path=str(path))),
}

if __name__ == '__main__':
    single_threaded()
    if sys.argv[1:2] == ['--open']:
        open_and_print(sys.argv[2], Path(sys.argv[3]))
    else:
        main()
