"""What aligning queries with the places found gives: answers, and poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

from offradar_ros.lab.evaluation.alignment_figures import LANE_M, NEAR_M, OTHER_WAY, PRECISIONS
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures, AnswerFigures, PoseFigures
from offradar_ros.lab.evaluation.table import number
from offradar_ros.lab.report.labels import method_label, percent, spacing_label
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source

ANSWERS_HEAD = (
    'method',
    'answers by',
    'queries',
    'on the map',
    'R@1 (%)',
    'R@k (%)',
    'R@10 (%)',
    'closed (%)',
    *(f'recall at {precision:g} (%)' for precision in PRECISIONS),
    'AUROC of p_right',
    'AUROC of the score',
)
POSES_HEAD = (
    'method',
    'poses of',
    'pairs',
    'within 2 m, 2° (%)',
    'median (m)',
    'median (°)',
    '90 % (m)',
    '90 % (°)',
    'within .5 m, .5° (%)',
    'NEES / 3',
    'in the 95 % ellipsoid (%)',
)


def alignment_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """Answers by distance alone and with alignments, and errors of poses, where queries were aligned."""
    figures = source.results.alignments.get(group, {}).get(spacing, {})
    methods = [name for name in source.methods if name in figures]
    where = f'{source.results.title(group)}, {spacing_label(spacing)}'
    scans = source.results.scans(group)
    answers = {name: found for name in methods if (found := figures[name].answers)}
    if answers:
        places = next(iter(answers.values())).places
        yield TableSection(
            f'aligned_answers_{group}_{spacing}m',
            f'Answers with alignments: {where}',
            f'Some queries of each pair of drives, each aligned with the k = {places} nearest places. By distance, the '
            'answer is the nearest place in embedding space; by distance and score, the likeliest of the k. R@k: one '
            'of the k is right, more than which no order of them can reach. R@10: one of the ten nearest is right. '
            'Closed: what alignments win of what the ten leave open, (R@1 with the score − R@1 by distance) / (R@10 − '
            'R@1 by distance). Recall at a precision: share of the queries on the map that is answered rightly at the '
            'lowest threshold on p_right at which the answers have this precision; with n answers, precision 1 − 1/n '
            'is the last below 1. AUROC: of right answers over wrong '
            f'ones and those off the map. Methods without coefficients for the score have no row; {scans}.',
            ANSWERS_HEAD,
            tuple(row for name, found in answers.items() for row in _answer_rows(name, found)),
        )
    if any(_poses(figures[name]) for name in methods):
        yield TableSection(
            f'aligned_poses_{group}_{spacing}m',
            f'Poses from alignments: {where}',
            'Errors of the poses of queries in the frames of the nearest places that they were aligned with, against '
            f'the positions and headings of the drives. By distance on the ground, in the direction of the place or '
            f'{OTHER_WAY} (headings over 120° apart); within {NEAR_M:g} m by direction and lane (another lane: over '
            f'{LANE_M:g} m to the side); and within {NEAR_M:g} m by fault of the query. Those by distance and way are '
            'of queries that are clean, or whose condition is unknown; places may be degraded. NEES / 3: of the poses '
            'within 2 m and 2°, the squared error in units of its covariance, over its three dimensions: 1 is what the '
            'covariance says, more is overconfident. In the 95 % ellipsoid: share of them, 95 expected. Parts of few '
            f'pairs say little; {scans}.',
            POSES_HEAD,
            tuple(
                (method_label(name), part, *_pose_cells(found))
                for name in methods
                for part, found in _poses(figures[name]).items()
            ),
        )


def _answer_rows(method: str, found: AnswerFigures) -> Iterator[tuple[str, ...]]:
    """By distance alone, and with alignments."""
    start = str(found.queries), str(found.on_map)
    by_distance = [at.by_distance for at in found.at_precision]
    aligned = [at.aligned for at in found.at_precision]
    before, after, most = found.recall_at_1_by_distance, found.recall_at_1_aligned, found.recall_at_10
    for how, recalls, at_precision, of_p, of_score in (
        ('distance', (before, found.recall_at_k, most, math.nan), by_distance, found.auroc_p_by_distance, math.nan),
        (
            'distance and score',
            (after, found.recall_at_k, most, found.closed),
            aligned,
            found.auroc_p_aligned,
            found.auroc_score,
        ),
    ):
        shares = map(percent, (*recalls, *at_precision))
        yield method_label(method), how, *start, *shares, number(of_p), number(of_score)


def _poses(figures: AlignmentFigures) -> dict[str, PoseFigures]:
    near = {f'within {NEAR_M:g} m, {part}': found for part, found in (figures.by_way | figures.by_fault).items()}
    return figures.by_distance | near


def _pose_cells(found: PoseFigures) -> tuple[str, ...]:
    return (
        str(found.pairs),
        percent(found.right),
        *(f'{value:.2f}' for value in (found.median_m, found.median_deg, found.quantile_90_m, found.quantile_90_deg)),
        percent(found.within_half),
        f'{found.nees:.2f}'.replace('nan', '-'),
        percent(found.in_ellipsoid),
    )
