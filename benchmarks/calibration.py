"""How reliable the probability is before and after `offradar calibrate` on drives of the same town: see README.md."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from embedded_worlds import options_of, worlds_parser
from numpy.typing import NDArray

from offradar_ros.calibration.cross_fit import cross_fit
from offradar_ros.calibration.encoded_drive import EncodedDrive
from offradar_ros.calibration.left_out_queries import left_out_queries
from offradar_ros.calibration.probability_scores import brier_score, expected_calibration_error
from offradar_ros.config import ConfidenceConfig
from offradar_ros.lab.evaluation.confidence import Setting, embed, joined
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.open_set import open_sets
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.retrieval.confidence import confidence_for, probability
from offradar_ros.retrieval.evidence import EvidenceTable

Judged = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Probabilities, and whether the answers are right."""


def main() -> None:
    """Print a table in Markdown: each group and map spacing, with each way to calibrate."""
    parser = worlds_parser(__doc__)
    arguments = parser.parse_args()
    options = options_of(arguments)
    protocol = read_protocol(arguments.protocol)
    info, worlds = embed(protocol, arguments.method, options)
    shipped = confidence_for(info.fingerprint, ConfidenceConfig())
    if shipped is None:
        parser.error(f'{arguments.method}: no coefficients ship for its model')
    print('| worlds | maps | coefficients | ECE | ECE of a town, mean | Brier score |\n|---|---|---|---|---|---|')
    for group in dict.fromkeys(group for group, _ in worlds):
        towns = [drives for (of_group, _), drives in worlds.items() if of_group == group]
        for spacing_m in protocol.map_spacings_m:
            made = [_town(drives, shipped, spacing_m, protocol) for drives in towns]
            for name in made[0]:
                _print(f'{group} | {Setting(spacing_m, 0)} | {name}', [town[name] for town in made])


def _print(title: str, towns: list[Judged]) -> None:
    p_right, right = (np.concatenate(column) for column in zip(*towns, strict=True))
    of_towns = np.mean([expected_calibration_error(*town) for town in towns])
    ece, brier = expected_calibration_error(p_right, right), brier_score(p_right, right)
    print(f'| {title} | {ece:.4f} | {of_towns:.4f} | {brier:.4f} |')


def _town(
    drives: list[EmbeddedDrive], shipped: ConfidenceConfig, spacing_m: float, protocol: Protocol
) -> dict[str, Judged]:
    """Probabilities by each way to calibrate, of searches of drives that had no part in it."""
    found: dict[str, list[Judged]] = {}
    for held, drive in enumerate(drives):
        others = [*drives[:held], *drives[held + 1 :]]
        # One drive calibrates, and the others are searched in each other's maps.
        ways = {'shipped': shipped, 'one drive': dataclasses.replace(shipped, usual_uncertainty=_usual([drive]))}
        evidence, right = joined(list(open_sets(others, spacing_m, protocol.tolerance_m)))
        for name, coefficients in ways.items():
            found.setdefault(name, []).append((probability(evidence, coefficients), right))
        # The others calibrate, and this drive is searched in their maps.
        queries = left_out_queries([_encoded(other) for other in others], MAP_SPACING_M, protocol.tolerance_m)
        learned = cross_fit(queries, dataclasses.replace(shipped, usual_uncertainty=_usual(others))).coefficients
        for evidence, right in _searched(drive, others, spacing_m, protocol.tolerance_m):
            found.setdefault('two drives', []).append((probability(evidence, learned), right))
    return {
        name: (np.concatenate([p for p, _ in parts]), np.concatenate([right for _, right in parts]))
        for name, parts in found.items()
    }


def _searched(
    drive: EmbeddedDrive, others: list[EmbeddedDrive], spacing_m: float, tolerance_m: float
) -> Iterator[tuple[EvidenceTable, NDArray[np.bool_]]]:
    for other in others:
        # Ordered pairs come with the map first; those of this drive in the other's map are the first two.
        yield joined(list(open_sets([other, drive], spacing_m, tolerance_m))[:2])


def _usual(drives: list[EmbeddedDrive]) -> float:
    return float(np.median(np.concatenate([drive.uncertainties[drive.usable] for drive in drives])))


def _encoded(embedded: EmbeddedDrive) -> EncodedDrive:
    drive = embedded.drive
    return EncodedDrive(
        drive.name, drive.stamps_ns, drive.poses, drive.driven_m, embedded.means, embedded.uncertainties
    )


if __name__ == '__main__':
    main()
