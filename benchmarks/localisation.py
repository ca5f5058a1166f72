"""What localisation decides on simulated drives of which half of the road is mapped: see README.md."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from belief_figures import RIGHT_WITHIN_M, Seen, start_figures, state_figures
from embedded_worlds import options_of, worlds_parser
from measuring import rounded
from numpy.typing import NDArray

from offradar_ros.calibration.open_set import halves
from offradar_ros.config import LocalisationConfig, QueryConfig, replace_values
from offradar_ros.lab.evaluation.answers import map_rows, places_of
from offradar_ros.lab.evaluation.confidence import Embedded, embed
from offradar_ros.lab.evaluation.distances import distances_m
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, PlaceTable, Pose

SEED = 5
SPEED_MPS = 10.0
STARTING_SCANS, STARTS = 20, 4
"""Scans of a cold start on the map, and how many are drawn from each drive in each map."""


class Case(NamedTuple):
    """A drive, and a map in its frame: half of the road."""

    places: PlaceTable
    query: EmbeddedDrive
    away_m: NDArray[np.float64]


def main() -> None:
    """Print a line for each group, kind of map, and odometry."""
    parser = worlds_parser(__doc__)
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='parameters of localisation')
    arguments = parser.parse_args()
    given = {name: float(value) for name, _, value in (text.partition('=') for text in arguments.set)}
    config = replace_values(LocalisationConfig(), given)
    protocol = read_protocol(arguments.protocol)
    options = options_of(arguments)
    info, worlds = embed(protocol, arguments.method, options)
    printed = False
    for spacing_m, group in itertools.product(protocol.map_spacings_m, dict.fromkeys(group for group, _ in worlds)):
        cases = list(_cases(worlds, group, spacing_m))
        for odometry in (True, False):
            figures = _figures(cases, config, info.fingerprint, odometry=odometry)
            if not printed:
                print(f'| drives | {" | ".join(figures)} |\n|---|{"---|" * len(figures)}')
                printed = True
            name = f'{group}, a map every {spacing_m:g} m, {"with" if odometry else "no"} odometry'
            print(f'| {name} | {" | ".join(f"{rounded(value):g}" for value in figures.values())} |', flush=True)


def _cases(worlds: Embedded, group: str, spacing_m: float) -> Iterator[Case]:
    for key, drives in worlds.items():
        for mapped, query in itertools.permutations(drives, 2) if key[0] == group else ():
            for rows in halves(mapped.drive.driven_m, map_rows(mapped, spacing_m)):
                if len(rows):
                    places = places_of(mapped, rows)
                    yield Case(places, query, distances_m(query.drive.poses, places.positions_m))


def _figures(cases: list[Case], config: LocalisationConfig, model: str, *, odometry: bool) -> dict[str, float]:
    rng = np.random.default_rng(SEED)
    drives, starts = [], []
    step_m = float(np.median(np.concatenate([np.diff(case.query.drive.driven_m) for case in cases])))
    for case in cases:
        drives.append(_localised(case, config, model, slice(None), odometry=odometry))
        on_map = np.convolve(case.away_m.min(axis=1) <= RIGHT_WITHIN_M, np.ones(STARTING_SCANS), 'valid')
        possible = np.flatnonzero(on_map == STARTING_SCANS)
        for start in rng.choice(possible, min(STARTS, len(possible)), replace=False).tolist():
            part = slice(start, start + STARTING_SCANS)
            starts.append(_localised(case, config, model, part, odometry=odometry))
    errors_m = [scan.error_m for seen in drives for scan in seen if scan.state == 'on_map' and not scan.wrong()]
    right_m = {'error on the map, median m': float(np.median(errors_m))}
    return start_figures(starts) | state_figures(drives, step_m) | right_m


def _localised(case: Case, config: LocalisationConfig, model: str, part: slice, *, odometry: bool) -> list[Seen]:
    """The query stage over these scans of a drive, at a constant speed, from a cold start."""
    stage = QueryStage(QueryConfig(), config)
    stage.load(case.places, model)
    query, seen = case.query, []
    for scan in range(len(query.means))[part]:
        driven_m = float(query.drive.driven_m[scan])
        stamp_ns = round(driven_m / SPEED_MPS * 1e9)
        usable = bool(query.usable[scan])
        mean = query.means[scan] if usable else np.empty(0, np.float32)
        if odometry:
            stage.add_odometry(stamp_ns, Pose(driven_m, 0.0))
        stage.query(Embedding(stamp_ns, mean, np.full(len(mean), query.uncertainties[scan], np.float32), model))
        found = stage.localise()
        if found is None or found.place_id is None:
            raise SystemExit(f'no localisation: {stage.not_localised}')
        away_m = case.away_m[scan]
        error_m = float(np.hypot(*(found.position_m - query.drive.poses[scan, :2])))
        seen.append(Seen(found.state, error_m, float(away_m.min()), usable))
    return seen


if __name__ == '__main__':
    main()
