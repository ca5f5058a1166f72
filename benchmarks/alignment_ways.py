"""Ways to align two scans, on the same pairs of simulated scans: see docs/alignment.md."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from measuring import Timing, rounded, single_threaded, write_results
from numpy.typing import NDArray
from recorded_answers import print_head, print_row
from registration_ways import WAYS, CfarIcp, FeaturePoints, Found, FourierMellin, Way
from scan_sources import announce_machine

from offradar_ros.cli.progress import progress_bar
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.evaluate import Options, open_worlds
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.lab.evaluation.protocol_file import read_protocol

WITHIN_M, ELSEWHERE_M = 10.0, 50.0
RIGHT_M, RIGHT_DEG = 2.0, 2.0
OTHER_WAY_RAD = math.radians(120.0)
SEED = 16
TUNING = 2
"""Worlds of each group that parameters are tuned on, and no figure is of."""
CONDITIONS = ('clean, the same way', 'clean, the other way', 'degraded, the same way', 'degraded, the other way')
ELSEWHERE = 'elsewhere'
TUNED: dict[str, tuple[Way, ...]] = {
    'Fourier–Mellin': tuple(
        FourierMellin(side, cell_m, blur, weakest, highest)
        for (side, cell_m), blur, weakest, highest in itertools.product(
            ((512, 0.4), (256, 0.8)), (1.0, 2.0), (6.0, 12.0, 20.0), (0.25, 0.5, 0.75)
        )
    ),
    'ORB': tuple(
        FeaturePoints(side, cell_m, blur, features, threshold, within_m)
        for (side, cell_m), blur, features, threshold, within_m in itertools.product(
            ((512, 0.4), (320, 0.5)), (1.0, 2.0), (1000, 2000), (3, 8), (0.8, 1.6)
        )
    ),
    'ICP': tuple(
        CfarIcp(above=above, strongest=strongest, reach_m=reach_m, starts=starts, last_m=last_m)
        for above, strongest, reach_m, starts, last_m in itertools.product(
            (20.0, 30.0, 45.0), (4, 8), (70.0, 100.0), (24, 48), (0.3, 0.6)
        )
    ),
}


class Pair(NamedTuple):
    """Two scans of one world, by drive and row, and the true pose of the query in the frame of the place."""

    condition: str
    place: tuple[Drive, int]
    query: tuple[Drive, int]
    pose: NDArray[np.float64]


def pairs_of(drives: Sequence[Drive], each: int, rng: np.random.Generator) -> Iterator[Pair]:
    """Up to `each` pairs of every condition, and as many of scans that are far apart."""
    found: dict[str, list[Pair]] = {}
    for mapped, asked in itertools.permutations(drives, 2):
        away_m = np.hypot(*(mapped.poses[:, None, :2] - asked.poses[None, :, :2]).transpose(2, 0, 1))
        for limited, far in ((away_m <= WITHIN_M, False), (away_m >= ELSEWHERE_M, True)):
            places, queries = np.nonzero(limited)
            chosen = rng.permutation(len(places))[: 60 * each]
            for place, query in zip(places[chosen].tolist(), queries[chosen].tolist(), strict=True):
                pose = _relative(mapped.poses[place], asked.poses[query])
                state = 'degraded' if mapped.kinds[place] or asked.kinds[query] else 'clean'
                way = 'other' if abs(pose[2]) > OTHER_WAY_RAD else 'same'
                condition = ELSEWHERE if far else f'{state}, the {way} way'
                found.setdefault(condition, []).append(Pair(condition, (mapped, place), (asked, query), pose))
    for condition in (*CONDITIONS, ELSEWHERE):
        of_condition = found.get(condition, [])
        for index in rng.permutation(len(of_condition))[:each].tolist():
            yield of_condition[index]


def _relative(place: NDArray[np.float64], query: NDArray[np.float64]) -> NDArray[np.float64]:
    cos, sin = math.cos(place[2]), math.sin(place[2])
    x_m, y_m = query[:2] - place[:2]
    yaw_rad = math.remainder(query[2] - place[2], 2.0 * math.pi)
    return np.array([cos * x_m + sin * y_m, cos * y_m - sin * x_m, yaw_rad])


@dataclasses.dataclass
class Tally:
    """What a way gave for one pair after another."""

    conditions: list[str] = dataclasses.field(default_factory=list)
    errors: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    scores: list[float] = dataclasses.field(default_factory=list)
    seconds: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    kept_bytes: list[int] = dataclasses.field(default_factory=list)

    def add(self, way: Way, pair: Pair) -> None:
        """Align a pair, and note how it went."""
        kept = [self._timed('keep', way.keep, drive.scan(row)) for drive, row in (pair.place, pair.query)]
        place, query = self._timed('place', way.place, kept[0]), self._timed('query', way.query, kept[1])
        found: Found = self._timed('align', way.align, place, query)
        off = found.pose - pair.pose
        degrees = abs(math.degrees(math.remainder(off[2], 2.0 * math.pi)))
        self.conditions.append(pair.condition)
        self.errors.append((float(np.hypot(off[0], off[1])), degrees))
        self.scores.append(found.score)
        self.kept_bytes.append(way.kept_bytes(kept[0]))

    def _timed(self, name: str, function: Any, *arguments: Any) -> Any:
        start_s = time.perf_counter()
        result = function(*arguments)
        self.seconds.setdefault(name, []).append(time.perf_counter() - start_s)
        return result

    def figures(self) -> dict[str, Any]:
        """Errors by condition, the score, times and bytes."""
        conditions, errors, scores = np.array(self.conditions), np.array(self.errors), np.array(self.scores)
        right = (errors[:, 0] <= RIGHT_M) & (errors[:, 1] <= RIGHT_DEG) & (conditions != ELSEWHERE)
        near = conditions != ELSEWHERE
        parts = {name: conditions == name for name in CONDITIONS} | {'all': near}
        return {
            'errors': {name: _errors(errors[part], right[part]) for name, part in parts.items() if part.any()},
            'auroc_near': rounded(auroc(scores[near], right[near])),
            'auroc_all': rounded(auroc(scores, right)),
            'bytes': float(np.median(self.kept_bytes)),
            'times': {name: Timing.of(seconds).as_dict() for name, seconds in self.seconds.items()},
        }


def _errors(errors: NDArray[np.float64], right: NDArray[np.bool_]) -> dict[str, float]:
    medians, most = np.quantile(errors, 0.5, axis=0), np.quantile(errors, 0.9, axis=0)
    values = {'median m': medians[0], '90 % m': most[0], 'median °': medians[1], '90 % °': most[1]}
    return {'pairs': len(errors), **{name: rounded(float(v)) for name, v in values.items()}, 'right': right.mean()}


def tuned(pairs: Sequence[Pair]) -> None:
    """Print how each setting does on the worlds for tuning, best last."""
    for name, ways in TUNED.items():
        rows = []
        for way in ways:
            tally = Tally()
            for pair in pairs:
                tally.add(way, pair)
            figures = tally.figures()
            whole = figures['errors']['all']
            rows.append((whole['right'], whole['median m'], figures['auroc_all'], way))
        print_head(name, 'right', 'median m', 'AUROC', 'setting')
        for right, median_m, told, way in sorted(rows, key=lambda row: (row[0], -row[1])):
            print_row(name, f'{right:.3f}', f'{median_m:.2f}', f'{told:.3f}', str(way))


def main() -> None:
    """Print a table of errors, and one of scores, times and bytes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('protocol', nargs='?', default='confidence', help='default: confidence')
    parser.add_argument('--cache', type=Path, required=True, help='folder of simulated scans, kept')
    parser.add_argument('--each', type=int, default=8, help='pairs of each condition in each world')
    parser.add_argument('--tune', action='store_true', help='only how settings do on the worlds for tuning')
    parser.add_argument('--out', type=Path, help='JSON file of the figures')
    arguments = parser.parse_args()
    announce_machine()
    cv2.setNumThreads(1)
    worlds, _ = open_worlds(
        read_protocol(arguments.protocol), Options(arguments.cache, arguments.cache, '', progress_bar, None)
    )
    groups: dict[str, list[Sequence[Drive]]] = {}
    for (group, _), drives in worlds.items():
        groups.setdefault(group, []).append(drives)
    part = slice(TUNING) if arguments.tune else slice(TUNING, None)
    rng = np.random.default_rng(SEED)
    pairs = [
        pair
        for of_group in groups.values()
        for drives in of_group[part]
        for pair in pairs_of(drives, arguments.each, rng)
    ]
    if arguments.tune:
        tuned(pairs)
        return
    tallies: dict[str, Tally] = {way.name: Tally() for way in WAYS}
    with progress_bar('aligning') as progress:
        for number, pair in enumerate(pairs):
            for way in WAYS:
                tallies[way.name].add(way, pair)
            progress(number + 1, len(pairs))
    found = {name: tally.figures() for name, tally in tallies.items()}
    print_tables(found)
    if arguments.out:
        write_results(arguments.out, {'ways': found}, {'pairs': SEED})


def print_tables(found: dict[str, dict[str, Any]]) -> None:
    """Errors of each condition, then the rest."""
    print_head('pairs', 'way', 'pairs', 'right', 'median', '90 %', 'median', '90 %')
    for condition, (name, figures) in itertools.product((*CONDITIONS, 'all'), found.items()):
        part = figures['errors'][condition]
        metres = (f'{part[title]:.2f} m' for title in ('median m', '90 % m'))
        degrees = (f'{part[title]:.2f}°' for title in ('median °', '90 % °'))
        print_row(condition, name, part['pairs'], f'{part["right"]:.1%}', *metres, *degrees)
    print_head(
        'way', 'AUROC within 10 m', 'and elsewhere', 'bytes of a place', 'from a scan', 'place', 'query', 'align'
    )
    for name, figures in found.items():
        times = (_time(figures['times'][step]) for step in ('keep', 'place', 'query', 'align'))
        print_row(
            name, f'{figures["auroc_near"]:.3f}', f'{figures["auroc_all"]:.3f}', f'{figures["bytes"]:.0f}', *times
        )


def _time(timing: dict[str, Any]) -> str:
    low, high = timing['quartiles_ms']
    return f'{timing["median_ms"]:.1f} ({low:.1f} to {high:.1f}) ms'


if __name__ == '__main__':
    single_threaded()
    main()
