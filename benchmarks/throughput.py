"""Scans per second of bags replayed in lockstep and of Oxford folders converted: see README.md."""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from drives import SCANS, SEED, offradar, simulated_drive, write_map
from measuring import cache_folder, rounded, single_threaded, write_results
from pipeline import ANY_U, DOMAIN_ID, NAMES, PLACES, RATE_HZ, Candidate, candidate, mapped

from offradar_ros.encoders.registry import make_encoder
from offradar_ros.lab.live.node_processes import Stack, isolated_environment

RESULTS = Path(__file__).parent / 'results' / 'throughput.json'
LOOPS = 3
CONVERSIONS = 5
REPLAY_S = 300.0


def replayed(encoder: Candidate, folder: Path, drive: Path) -> dict[str, Any]:
    """Scans per second of `replay_node --lockstep`, with nodes that map, and search 10,000 places."""
    info = make_encoder(encoder.config(threads=0)).info
    map_path = write_map(folder / 'search.db', info, drive, PLACES)
    parameters = {**encoder.parameters(threads=0), **ANY_U, **mapped(map_path)}
    report = folder / 'replay.json'
    with Stack(folder / 'logs' / f'replay_{encoder.name}', DOMAIN_ID, parameters) as nodes:
        nodes.wait_until_ready()
        for loops in (1, LOOPS):
            # The first loop warms the nodes up.
            words = [str(drive), '--lockstep', '--loop', str(loops), '--report', str(report)]
            replay = nodes.start('replay_node', words, 'replay')
            try:
                if replay.wait(REPLAY_S):
                    raise SystemExit(f'error: replay failed: {replay.last_line()}')
            finally:
                replay.stop()
    replay_report = json.loads(report.read_text(encoding='utf-8'))
    rate = replay_report['scans'] / replay_report['seconds']
    return {
        'scans': replay_report['scans'],
        'unanswered': replay_report['unanswered'],
        'scans_per_s': rounded(rate),
        'times_real_time': rounded(rate / RATE_HZ),
        'median_ms': rounded(float(np.median(replay_report['latencies_s'])) * 1e3),
    }


def converted(folder: Path) -> dict[str, Any]:
    """Scans per second of `offradar convert`, an Oxford folder to a bag, including the start of the interpreter."""
    source, taken_s = simulated_drive(folder, 'oxford'), []
    for _ in range(CONVERSIONS):
        started_s = time.perf_counter()
        offradar('convert', source, folder / 'converted', '--overwrite')
        taken_s.append(time.perf_counter() - started_s)
    return {'scans': SCANS, 'conversions': CONVERSIONS, 'scans_per_s': rounded(SCANS / float(np.median(taken_s)))}


def main() -> None:
    """Measure both; print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--folder', type=Path, default=Path('build/bench'), help='where drives and networks are kept')
    parser.add_argument('--vgg16', default='', metavar='FILE', help='trained weights (.safetensors); default: random')
    parser.add_argument('--out', type=Path, default=RESULTS, help='default: the results in the repository')
    arguments = parser.parse_args()
    os.environ.update(isolated_environment(DOMAIN_ID))
    folder = cache_folder(arguments.folder)
    drive = simulated_drive(folder)
    replays = {}
    for name in NAMES:
        replays[name] = row = replayed(candidate(name, folder, drive, arguments.vgg16), folder, drive)
        print(f'{name:12} {row["scans_per_s"]:6.1f} scans/s, {row["times_real_time"]:.1f} times real time', flush=True)
    conversion = converted(folder)
    print(f'Oxford PNGs converted: {conversion["scans_per_s"]:.1f} scans/s')
    write_results(arguments.out, {'lockstep': replays, 'conversion': conversion}, {'drive': SEED, 'weights': SEED})


if __name__ == '__main__':
    single_threaded()
    main()
