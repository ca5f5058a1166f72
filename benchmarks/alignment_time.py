"""What alignments cost on one core: a signature, a query, a place, a pair, and five candidates; see README.md."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import cv2
from measuring import ROOT, Timing, interleaved, single_threaded, write_results
from recorded_answers import print_head, print_row
from sample_signatures import packed_turns
from scan_sources import REAL, announce_machine, scan_sources

from offradar_ros.alignment.align import align, prepare_place, prepare_query
from offradar_ros.alignment.scan_odometry import ScanOdometry
from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.signature_code import pack, unpack
from offradar_ros.retrieval.verification import PREPARED, Verifier
from offradar_ros.types import PolarScan, ScanKey

SOURCES = ('simulated, 0.1736 m', 'simulated, 0.0432 m', 'oxford_tiny')
SCANS = 11
CANDIDATES = 5
REPEATS = 300
TARGETS_MS = {'align': 10.0, 'five, cold': 25.0, 'five, prepared': 25.0}


@dataclasses.dataclass(frozen=True)
class HeldSignatures:
    """Signatures in memory, by their scans, as `SignatureSource` has them."""

    contents: Mapping[ScanKey, bytes]

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """Those of these scans."""
        return {scan: self.contents[scan] for scan in scans}


def steps(scans: Sequence[PolarScan]) -> dict[str, Callable[[], object]]:
    """Each step, as a call that takes the next scans every time.

    A place is a scan, the query the one after it. *Cold* candidates have never been aligned with before, but for more
    of them than are kept; *prepared* ones are those of the query before.
    """
    make = SignatureMaker()
    signatures = [make(scan) for scan in scans]
    contents = [pack(signature) for signature in signatures]
    pairs = [(prepare_place(place), prepare_query(query)) for place, query in itertools.pairwise(signatures)]
    turned = packed_turns(signatures, 2 * PREPARED)
    held = HeldSignatures({ScanKey(1, number): content for number, content in enumerate(turned)})
    cold, warm = Verifier(held), Verifier(held)
    numbers = itertools.cycle(range(0, len(turned) - CANDIDATES, CANDIDATES))
    names = ('signature', 'unpack', 'place', 'query', 'velocity', 'five')
    following = {name: itertools.cycle(range(len(scans))) for name in names}
    pair = itertools.cycle(pairs)

    odometry, stamps_ns = ScanOdometry(), itertools.count(0, 250_000_000)

    def cold_five() -> object:
        first = next(numbers)
        places = [ScanKey(1, number) for number in range(first, first + CANDIDATES)]
        return cold.align(contents[next(following['five'])], places)

    def warm_five() -> object:
        return warm.align(contents[next(following['five'])], [ScanKey(1, number) for number in range(CANDIDATES)])

    return {
        'signature': lambda: pack(make(scans[next(following['signature'])])),
        'unpack': lambda: unpack(contents[next(following['unpack'])]),
        'place': lambda: prepare_place(signatures[next(following['place'])]),
        'query': lambda: prepare_query(signatures[next(following['query'])]),
        'velocity': lambda: odometry.twist(signatures[next(following['velocity'])], next(stamps_ns)),
        'align': lambda: align(*next(pair)),
        'five, cold': cold_five,
        'five, prepared': warm_five,
    }


def main() -> None:
    """Measure, print a table, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--real', type=Path, default=REAL, metavar='FOLDER', help=f'recorded scans (default {REAL})')
    parser.add_argument('--out', type=Path, default=ROOT / 'benchmarks' / 'results' / 'alignment_time.json')
    arguments = parser.parse_args()
    announce_machine()
    cv2.setNumThreads(1)
    found: dict[str, dict[str, Timing]] = {}
    for name, scans in scan_sources(arguments.real, SCANS):
        if name in SOURCES:
            found[name] = interleaved(steps(scans), REPEATS, warm_up=10)
    print_head('ms on one core', *next(iter(found.values())))
    for name, times in found.items():
        print_row(name, *(_cell(timing, TARGETS_MS.get(step)) for step, timing in times.items()))
    record = {name: {step: timing.as_dict() for step, timing in times.items()} for name, times in found.items()}
    write_results(arguments.out, {'targets_ms': TARGETS_MS, 'steps': record})


def _cell(timing: Timing, target_ms: float | None) -> str:
    low, high = timing.quartiles_ms
    missed = ' (missed)' if target_ms is not None and timing.median_ms > target_ms else ''
    return f'{timing.median_ms:.2f} ({low:.2f} to {high:.2f}){missed}'


if __name__ == '__main__':
    single_threaded()
    main()
