"""What aligning scans with the places found gives: better order, a better probability, and a pose; see README.md."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from embedded_worlds import options_of, worlds_parser
from measuring import rounded
from numpy.typing import NDArray
from scipy.stats import chi2

from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.lab.evaluation.aligned import AlignedAnswers, answers_of_worlds, joined_answers
from offradar_ros.lab.evaluation.confidence import embed, nearest_odds
from offradar_ros.lab.evaluation.metrics.accepted_at_precision import accepted_at_precision
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.records import read_record
from offradar_ros.retrieval.confidence import confidence_for, log_odds, verified

PLACES = QueryConfig().verify_candidates
RANGES_M = ((0.0, 2.0), (2.0, 5.0), (5.0, 10.0), (10.0, 15.0), (15.0, 25.0))
GROSS_M, GROSS_DEG = 2.0, 2.0
"""A pose that is farther off than this is wrong, whatever its covariance."""
PRECISIONS = (0.99, 0.999)
OTHER_WAY_RAD = math.radians(120.0)
"""Headings that differ by more than this are those of a road that is driven the other way."""


def main() -> None:
    """Print a table of answers and one of poses, for each group of the protocol and kind of map."""
    parser = worlds_parser(__doc__)
    parser.add_argument('--confidence', type=Path, help='coefficients, instead of those that ship')
    parser.add_argument('--queries', type=int, default=24, help='scans of each drive that are searched in each map')
    parser.add_argument('--whole', action='store_true', help='maps hold the whole road')
    parser.add_argument('--out', type=Path, help='JSON file of the figures')
    arguments = parser.parse_args()
    protocol = read_protocol(arguments.protocol)
    options = options_of(arguments)
    info, worlds = embed(protocol, arguments.method, options)
    coefficients = confidence_for(info.fingerprint, ConfidenceConfig())
    if arguments.confidence:
        coefficients = read_record(ConfidenceConfig, arguments.confidence)
    if coefficients is None:
        raise SystemExit(f'no coefficients for {arguments.method}: --confidence FILE')
    answers: dict[str, dict[str, float]] = {}
    poses: dict[str, dict[str, float]] = {}
    for group in dict.fromkeys(group for group, _ in worlds):
        for spacing_m in protocol.map_spacings_m:
            of_group = [drives for key, drives in worlds.items() if key[0] == group]
            made = answers_of_worlds(
                of_group, protocol, [spacing_m], places=PLACES, queries=arguments.queries, whole=arguments.whole
            )
            joined = joined_answers(made)
            name = f'{group}, a map every {spacing_m:g} m'
            answers[name] = answer_figures(joined, coefficients, protocol.tolerance_m)
            poses |= {f'{name}: {part}': figures for part, figures in pose_figures(joined).items()}
    for table in (answers, poses):
        _print(table)
    if arguments.out:
        arguments.out.write_text(json.dumps({'answers': answers, 'poses': poses}, indent=1) + '\n')


def answer_figures(answers: AlignedAnswers, coefficients: ConfidenceConfig, tolerance_m: float) -> dict[str, float]:
    """Shares of the queries on the map, by distance alone and with alignments."""
    shape, every = answers.scores.shape, np.arange(len(answers))
    right, on_map = answers.away_m <= tolerance_m, answers.on_map
    odds = log_odds(answers.evidence, coefficients).reshape(shape)
    by_distance = nearest_odds(answers.evidence, shape, coefficients)
    first = np.argmax(verified(by_distance, answers.scores, coefficients), axis=1)
    before, after = right[:, 0], right[every, first]
    chosen = verified(odds, answers.scores, coefficients)[every, first]
    figures: dict[str, float] = {
        'queries': len(answers),
        'on the map': float(on_map.mean()),
        'Recall@1 by distance': float(before[on_map].mean()),
        'Recall@1 aligned': float(after[on_map].mean()),
        f'Recall@{shape[1]}': float(right[on_map].any(axis=1).mean()),
    }
    for precision in PRECISIONS:
        for name, odd, one in (('by distance', odds[:, 0], before), ('aligned', chosen, after)):
            accepted = accepted_at_precision(odd, one, precision)
            figures[f'recall at {precision:g} {name}'] = float((accepted & one)[on_map].mean())
    figures['AUROC of the score'] = auroc(answers.scores[every, first], after)
    figures['AUROC of p by distance'] = auroc(odds[:, 0], before)
    figures['AUROC of p aligned'] = auroc(chosen, after)
    return figures


def pose_figures(answers: AlignedAnswers) -> dict[str, dict[str, float]]:
    """Errors of the poses at the nearest places, by their distance on the ground, direction, and fault."""
    errors, away_m = answers.errors, answers.away_m
    other_way = np.abs(answers.turned_rad) > OTHER_WAY_RAD
    clean = answers.kinds == ''
    within = away_m <= 10.0
    parts = {
        f'{low:g} to {high:g} m': (away_m >= low) & (away_m < high) & clean[:, None] & ~other_way[:, None]
        for low, high in RANGES_M
    }
    parts['within 10 m, the other way'] = within & clean[:, None] & other_way[:, None]
    kinds = [kind for kind in np.unique(answers.kinds).tolist() if kind]
    parts |= {f'within 10 m, {kind}': within & (answers.kinds == kind)[:, None] for kind in kinds}
    return {
        name: _errors(errors[part], answers.covariances[part], answers.scores[part]) for name, part in parts.items()
    }


def _errors(
    errors: NDArray[np.float64], covariances: NDArray[np.float64], scores: NDArray[np.float64]
) -> dict[str, float]:
    known = np.isfinite(scores)
    errors, covariances = errors[known], covariances[known]
    if not len(errors):
        return {'pairs': 0}
    distance_m, angle_deg = np.hypot(errors[:, 0], errors[:, 1]), np.degrees(np.abs(errors[:, 2]))
    right = (distance_m <= GROSS_M) & (angle_deg <= GROSS_DEG)
    sound = errors[right]
    squares = np.einsum('ni,nij,nj->n', sound, np.linalg.inv(covariances[right]), sound)
    return {
        'pairs': len(errors),
        'right': float(right.mean()),
        'median m': float(np.median(distance_m)),
        '90 % m': float(np.quantile(distance_m, 0.9)),
        'median °': float(np.median(angle_deg)),
        '90 % °': float(np.quantile(angle_deg, 0.9)),
        'within .5 m and .5°': float(((distance_m <= 0.5) & (angle_deg <= 0.5)).mean()),
        'NEES of right ones': float(squares.mean() / 3.0) if len(squares) else math.nan,
        'in the 95 % ellipsoid': float((squares <= chi2.ppf(0.95, 3)).mean()) if len(squares) else math.nan,
    }


def _print(table: dict[str, dict[str, float]]) -> None:
    titles = list(dict.fromkeys(title for figures in table.values() for title in figures))
    print(f'| drives | {" | ".join(titles)} |\n|---|{"---|" * len(titles)}')
    for name, figures in table.items():
        shown = (f'{rounded(figures[title]):g}' if title in figures else '' for title in titles)
        print(f'| {name} | {" | ".join(shown)} |')
    print(flush=True)


if __name__ == '__main__':
    main()
