"""What aligning scans with the places found gives: better order, a better probability, and a pose; see README.md."""

from __future__ import annotations

import json
from pathlib import Path

from embedded_worlds import options_of, worlds_parser
from measuring import rounded

from offradar_ros.calibration.probability_scores import expected_calibration_error
from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.lab.evaluation.aligned import AlignedAnswers, answers_of_worlds, joined_answers
from offradar_ros.lab.evaluation.alignment_figures import NEAR_M, alignment_figures, first_places
from offradar_ros.lab.evaluation.confidence import embed
from offradar_ros.lab.evaluation.open_set_summary import gate_figures
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures, AnswerFigures
from offradar_ros.records import read_record
from offradar_ros.retrieval.confidence import confidence_for, logistic

PLACES = QueryConfig().verify_candidates


def main() -> None:
    """Print tables of answers, of the gate, and of poses, for each group of the protocol and kind of map."""
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
    gates: dict[str, dict[str, float]] = {}
    poses: dict[str, dict[str, float]] = {}
    for group in dict.fromkeys(group for group, _ in worlds):
        for spacing_m in protocol.map_spacings_m:
            of_group = [drives for key, drives in worlds.items() if key[0] == group]
            made = answers_of_worlds(
                of_group, protocol, [spacing_m], places=PLACES, queries=arguments.queries, whole=arguments.whole
            )
            joined = joined_answers(made)
            figures = alignment_figures(joined, coefficients, protocol.tolerance_m)
            if figures.answers is None:
                raise SystemExit(f'the coefficients for {arguments.method} leave alignments out (score is 0)')
            name = f'{group}, a map every {spacing_m:g} m'
            answers[name] = shown_answers(figures.answers)
            gates[name] = shown_gate(joined, coefficients, protocol.tolerance_m)
            poses |= {f'{name}: {part}': shown for part, shown in shown_poses(figures).items()}
    for table in (answers, gates, poses):
        _print(table)
    if arguments.out:
        arguments.out.write_text(json.dumps({'answers': answers, 'gates': gates, 'poses': poses}, indent=1) + '\n')


def shown_answers(figures: AnswerFigures) -> dict[str, float]:
    """Figures by the titles of their columns; shares of the queries on the map."""
    shown: dict[str, float] = {
        'queries': figures.queries,
        'on the map': figures.on_map / figures.queries,
        'Recall@1 by distance': figures.recall_at_1_by_distance,
        'Recall@1 aligned': figures.recall_at_1_aligned,
        f'Recall@{figures.places}': figures.recall_at_k,
        'Recall@10': figures.recall_at_10,
        'of what Recall@10 leaves open, closed': figures.closed,
    }
    for at in figures.at_precision:
        shown[f'recall at {at.precision:g} by distance'] = at.by_distance
        shown[f'recall at {at.precision:g} aligned'] = at.aligned
    shown['AUROC of the score'] = figures.auroc_score
    shown['AUROC of p by distance'] = figures.auroc_p_by_distance
    shown['AUROC of p aligned'] = figures.auroc_p_aligned
    return shown


def shown_gate(answers: AlignedAnswers, coefficients: ConfidenceConfig, tolerance_m: float) -> dict[str, float]:
    """What the default gate on the probability answers, by the titles of columns, and how well p is calibrated."""
    least, clean = QueryConfig().min_probability, answers.kinds == ''
    shown: dict[str, float] = {}
    for how, found in zip(('by distance', 'aligned'), first_places(answers, coefficients, tolerance_m), strict=True):
        p_right = logistic(found.log_odds)
        gate = gate_figures('p_right', least, p_right >= least, found.right, answers.on_map, clean)
        shown[f'ECE {how}'] = expected_calibration_error(p_right, found.right)
        shown[f'gate answers on the map, {how}'] = gate.answered_on_map
        shown[f'of clean scans, {how}'] = gate.answered_on_map_clean
        shown[f'off the map, {how}'] = gate.answered_off_map
        shown[f'of its answers wrong, {how}'] = gate.wrong
    return shown


def shown_poses(figures: AlignmentFigures) -> dict[str, dict[str, float]]:
    """Figures by part, and by the titles of their columns."""
    near = {f'within {NEAR_M:g} m, {part}': found for part, found in (figures.by_way | figures.by_fault).items()}
    return {
        part: {
            'pairs': found.pairs,
            'right (within 2 m and 2°)': found.right,
            'median m': found.median_m,
            '90 % m': found.quantile_90_m,
            'median °': found.median_deg,
            '90 % °': found.quantile_90_deg,
            'within .5 m and .5°': found.within_half,
            'NEES / 3 of right ones (1 if the covariance is true)': found.nees,
            'right ones in the 95 % ellipsoid': found.in_ellipsoid,
        }
        for part, found in (figures.by_distance | near).items()
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
