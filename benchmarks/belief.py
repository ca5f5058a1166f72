"""Time of the belief over a map of 10,000 and 100,000 places, and what it decides on simulated evidence.

README.md explains each figure. The first line printed is the machine.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from belief_figures import RIGHT_WITHIN_M, TOLERANCE_M, Seen, start_figures, state_figures
from measuring import Timing, interleaved, machine, rounded, single_threaded, write_results
from numpy.typing import NDArray
from simulated_evidence import PERIOD_NS, STEP_M, Streets, localised

from offradar_ros.belief.place_belief import PlaceBelief
from offradar_ros.config import ConfidenceConfig, LocalisationConfig, QueryConfig, replace_values
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, Outcome, PlaceTable

SEED = 11
SIZES = (10_000, 100_000)
STREETS = ((12, 5.0), (12, 15.0), (20, 5.0))
"""Blocks along a side, and distance between places; half of the streets are mapped."""
STARTING_SCANS = 40
DIMENSION, MODEL = 128, 'a' * 64
"""As embeddings of `compact`."""


def main() -> None:
    """Measure both parts and print them as tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('parts', nargs='*', help=f'some of {", ".join(PARTS)} (default: all)')
    parser.add_argument('--starts', type=int, default=300, help='cold starts of each kind (default: 300)')
    parser.add_argument('--scans', type=int, default=4000, help='scans of each long drive (default: 4000)')
    parser.add_argument(
        '--correlated-m',
        type=float,
        default=0.0,
        help='distance over which the noise of scans decays to 1/e (default: 0)',
    )
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='parameters of LocalisationConfig')
    parser.add_argument('--out', type=Path, help='also write the figures as JSON')
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(PARTS):
        parser.error(f'no such part: {", ".join(sorted(unknown))}')
    given = {name: float(value) for name, _, value in (s.partition('=') for s in arguments.set)}
    config = replace_values(LocalisationConfig(), given)
    print(json.dumps(machine()), flush=True)
    results = {part: PARTS[part](config, arguments) for part in arguments.parts or PARTS}
    if arguments.out:
        write_results(arguments.out, results, {'streets, drives and evidence': SEED}, {})


def measure_cost(config: LocalisationConfig, _: argparse.Namespace) -> dict[str, Any]:
    """Time of one scan in several situations, called in turn."""
    print('| places | call | median | quartiles | 99 % |\n|---|---|---|---|---|')
    found: dict[str, Any] = {}
    for places in SIZES:
        # Every street is mapped every 5 m: the densest map that Algorithm 1 makes with its defaults.
        blocks = int(np.sqrt(places / 48)) + 1
        positions_m = Streets.drawn(blocks, 5.0, 1.0, SEED).positions_m[:places]
        rng = np.random.default_rng(SEED)
        draws = rng.normal(-6.7, 3.7, (8, places))
        ids = np.arange(places)
        calls = {
            'cold start': _cold_start(config, positions_m, draws),
            'scan, odometry': _stepping(config, positions_m, draws, STEP_M, 1),
            'scan, no odometry': _stepping(config, positions_m, draws, None, 1),
            'after 5 s without a scan': _stepping(config, positions_m, draws, None, 20),
            **_answering(config, positions_m, rng),
        }
        taken = interleaved(calls, repeats=200, warm_up=3, seconds=30.0)
        taken['another map'] = _map_changes(config, positions_m, ids)
        for name, timing in taken.items():
            low, high = timing.quartiles_ms
            print(
                f'| {places:,} | {name} | {timing.median_ms:.2f} ms | {low:.2f} to {high:.2f} | {timing.p99_ms:.2f} |'
            )
        found[str(places)] = {name: timing.as_dict() for name, timing in taken.items()}
    return found


def _cold_start(
    config: LocalisationConfig, positions_m: NDArray[np.float64], draws: NDArray[np.float64]
) -> Callable[[], object]:
    """The first scan, when every place has probability."""
    belief = PlaceBelief(config, TOLERANCE_M)
    belief.set_places(positions_m, np.arange(len(positions_m)))

    def first_scan() -> None:
        belief.reset()
        belief.step(1, draws[0], 0.0)

    return first_scan


def _stepping(
    config: LocalisationConfig,
    positions_m: NDArray[np.float64],
    draws: NDArray[np.float64],
    travelled_m: float | None,
    periods: int,
) -> Callable[[], object]:
    belief = PlaceBelief(config, TOLERANCE_M)
    belief.set_places(positions_m, np.arange(len(positions_m)))
    scans = itertools.count(1)

    def scan() -> None:
        index = next(scans)
        belief.step(index * periods * PERIOD_NS, draws[index % len(draws)], travelled_m)

    return scan


def _answering(
    config: LocalisationConfig, positions_m: NDArray[np.float64], rng: np.random.Generator
) -> dict[str, Callable[[], object]]:
    """The query stage on random means: an answer alone, and with the localisation after it."""
    means = rng.normal(size=(len(positions_m), DIMENSION)).astype(np.float32)
    count = len(means)
    table = PlaceTable(
        np.arange(count),
        np.ones(count, np.int32),
        np.arange(count),
        np.column_stack([positions_m, np.zeros(count)]),
        np.zeros(count),
        np.full(count, np.nan, np.float32),
        np.ones(count, np.float32),
        means,
    )
    scans, ones = itertools.count(1), np.ones(DIMENSION, np.float32)
    coefficients = ConfidenceConfig(model=MODEL, distance=-1.0, spatial_ratio=-1.0, place_ratio=-1.0)
    stage = QueryStage(QueryConfig(confidence=coefficients), config)
    stage.load(table, MODEL)

    def answer() -> Outcome:
        number = next(scans)
        return stage.query(Embedding(number * PERIOD_NS, means[number % count] + np.float32(0.1), ones, MODEL))

    return {'answer': answer, 'answer and localisation': lambda: (answer(), stage.localise())}


def _map_changes(config: LocalisationConfig, positions_m: NDArray[np.float64], ids: NDArray[np.int64]) -> Timing:
    belief = PlaceBelief(config, TOLERANCE_M)
    taken = []
    for kept in (len(ids), len(ids) - 10, len(ids)):
        start_s = time.perf_counter()
        belief.set_places(positions_m[:kept], ids[:kept])
        taken.append(time.perf_counter() - start_s)
    return Timing.of(taken)


def measure_decisions(config: LocalisationConfig, arguments: argparse.Namespace) -> dict[str, Any]:
    """Cold starts on the map, and long drives on and off it."""
    found: dict[str, Any] = {}
    for (blocks, spacing_m), odometry in itertools.product(STREETS, (True, False)):
        streets = Streets.drawn(blocks, spacing_m, 0.5, SEED)
        belief = PlaceBelief(config, TOLERANCE_M)
        belief.set_places(streets.positions_m, np.arange(len(streets.positions_m)))

        def drive(
            scans: int,
            rng: np.random.Generator,
            belief: PlaceBelief = belief,
            streets: Streets = streets,
            odometry: bool = odometry,
        ) -> list[Seen]:
            return localised(belief, streets, scans, odometry, rng, arguments.correlated_m)

        rng = np.random.default_rng(SEED + 1)
        figures = _starts(drive, rng, arguments.starts) | state_figures([drive(arguments.scans, rng)], STEP_M)
        figures = {key: rounded(value) for key, value in figures.items()}
        name = f'{len(belief.place_ids):,} places, every {spacing_m:g} m, {"with" if odometry else "no"} odometry'
        if not found:
            print(f'| map | {" | ".join(figures)} |\n|---|{"---|" * len(figures)}')
        print(f'| {name} | {" | ".join(f"{value:g}" for value in figures.values())} |', flush=True)
        found[name] = figures
    return found


def _starts(
    drive: Callable[[int, np.random.Generator], list[Seen]], rng: np.random.Generator, starts: int
) -> dict[str, float]:
    drives: list[list[Seen]] = []
    while len(drives) < starts:
        seen = drive(STARTING_SCANS, rng)
        if all(scan.nearest_m <= RIGHT_WITHIN_M for scan in seen):
            drives.append(seen)
    return start_figures(drives)


PARTS: dict[str, Callable[[LocalisationConfig, argparse.Namespace], dict[str, Any]]] = {
    'cost': measure_cost,
    'decisions': measure_decisions,
}

if __name__ == '__main__':
    single_threaded()
    main()
