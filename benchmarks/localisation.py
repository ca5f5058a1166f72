"""What localisation decides on simulated drives of which half of the road is mapped: see README.md."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from belief_figures import RIGHT_WITHIN_M, Seen, position_figures, start_figures, state_figures
from embedded_worlds import options_of, worlds_parser
from measuring import rounded
from numpy.typing import NDArray

from offradar_ros.calibration.drive_signatures import DriveSignatures
from offradar_ros.calibration.open_set import halves
from offradar_ros.config import LocalisationConfig, QueryConfig, replace_values
from offradar_ros.lab.evaluation.answers import map_rows, places_of
from offradar_ros.lab.evaluation.confidence import embed
from offradar_ros.lab.evaluation.distances import distances_m
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.retrieval.introspective_query import Answer, IntrospectiveQuery
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.verification import Verifier
from offradar_ros.stages.localise import LocaliseStage
from offradar_ros.types import Embedding, PlaceTable, Pose

SEED = 5
SPEED_MPS = 10.0
STARTING_SCANS, STARTS = 20, 4
"""Scans of a cold start on the map, and how many are drawn from each drive in each map."""


class Case(NamedTuple):
    """A drive in a map of half of the road, in its frame: the answer to each scan, and what is known of the truth."""

    places: PlaceTable
    query: EmbeddedDrive
    answers: list[Answer]
    away_m: NDArray[np.float64]


def main() -> None:
    """Print a line for each group, kind of map, and odometry."""
    parser = worlds_parser(__doc__)
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='parameters of localisation')
    parser.add_argument('--no-verify', action='store_true', help='without alignments, as with query.verify: false')
    parser.add_argument('--worlds', type=int, default=0, help='most worlds of each group (default: all)')
    arguments = parser.parse_args()
    given = {name: float(value) for name, _, value in (text.partition('=') for text in arguments.set)}
    config = replace_values(LocalisationConfig(), given)
    query = QueryConfig(verify=not arguments.no_verify)
    protocol = read_protocol(arguments.protocol)
    options = options_of(arguments)
    info, worlds = embed(protocol, arguments.method, options)
    printed = False
    for spacing_m, group in itertools.product(protocol.map_spacings_m, dict.fromkeys(group for group, _ in worlds)):
        of_group = [drives for key, drives in worlds.items() if key[0] == group]
        cases = list(_cases(of_group[: arguments.worlds or None], spacing_m, query, info.fingerprint))
        for odometry in (True, False):
            figures = _figures(cases, config, query.tolerance_m, odometry=odometry)
            if not printed:
                print(f'| drives | {" | ".join(figures)} |\n|---|{"---|" * len(figures)}')
                printed = True
            name = f'{group}, a map every {spacing_m:g} m, {"with" if odometry else "no"} odometry'
            print(f'| {name} | {" | ".join(f"{rounded(value):g}" for value in figures.values())} |', flush=True)


def _cases(
    worlds: Sequence[Sequence[EmbeddedDrive]], spacing_m: float, config: QueryConfig, model: str
) -> Iterator[Case]:
    for drives in worlds:
        signatures = DriveSignatures([drive.drive for drive in drives])
        for mapped, query in itertools.permutations(drives, 2):
            for rows in halves(mapped.drive.driven_m, map_rows(mapped, spacing_m)):
                if len(rows):
                    session = np.full(len(rows), signatures.number_of(mapped.drive), np.int32)
                    places = dataclasses.replace(places_of(mapped, rows), session_ids=session)
                    answers = list(_answers(places, query, signatures, config, model))
                    yield Case(places, query, answers, distances_m(query.drive.poses, places.positions_m))


def _answers(
    places: PlaceTable, query: EmbeddedDrive, signatures: DriveSignatures, config: QueryConfig, model: str
) -> Iterator[Answer]:
    """What the query stage answers to each scan of a drive; the belief over them is made of nothing else."""
    searched = SearchedMap()
    searched.load(places, model)
    introspective = IntrospectiveQuery(config, searched, Verifier(signatures))
    for row, stamp_ns in enumerate(_stamps_ns(query)):
        usable = bool(query.usable[row])
        mean = query.means[row] if usable else np.empty(0, np.float32)
        variance = np.full(len(mean), query.uncertainties[row], np.float32)
        signature = signatures.of(query.drive, row) if usable and config.verify else b''
        yield introspective.answer(Embedding(stamp_ns, mean, variance, model, signature))


def _stamps_ns(query: EmbeddedDrive) -> list[int]:
    """Stamps of a drive at a constant speed."""
    return [round(driven_m / SPEED_MPS * 1e9) for driven_m in query.drive.driven_m.tolist()]


def _figures(cases: list[Case], config: LocalisationConfig, tolerance_m: float, *, odometry: bool) -> dict[str, float]:
    rng = np.random.default_rng(SEED)
    drives, starts = [], []
    step_m = float(np.median(np.concatenate([np.diff(case.query.drive.driven_m) for case in cases])))
    for case in cases:
        drives.append(_localised(case, config, tolerance_m, slice(None), odometry=odometry))
        on_map = np.convolve(case.away_m.min(axis=1) <= RIGHT_WITHIN_M, np.ones(STARTING_SCANS), 'valid')
        possible = np.flatnonzero(on_map == STARTING_SCANS)
        for start in rng.choice(possible, min(STARTS, len(possible)), replace=False).tolist():
            part = slice(start, start + STARTING_SCANS)
            starts.append(_localised(case, config, tolerance_m, part, odometry=odometry))
    return start_figures(starts) | state_figures(drives, step_m) | position_figures(drives)


def _localised(
    case: Case, config: LocalisationConfig, tolerance_m: float, part: slice, *, odometry: bool
) -> list[Seen]:
    """The belief over these scans of a drive, from a cold start."""
    stage = LocaliseStage(config, tolerance_m)
    stage.set_places(case.places.positions_m, case.places.place_ids)
    query, stamps_ns, seen = case.query, _stamps_ns(case.query), []
    for scan in range(len(stamps_ns))[part]:
        if odometry:
            stage.add_odometry(stamps_ns[scan], Pose(float(query.drive.driven_m[scan]), 0.0))
        answer = case.answers[scan]
        found = stage.add_scan(stamps_ns[scan], answer.similar, answer.pose)
        seen.append(
            Seen.of(found, query.drive.poses[scan, :2], float(case.away_m[scan].min()), bool(query.usable[scan]))
        )
    return seen


if __name__ == '__main__':
    main()
