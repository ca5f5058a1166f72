"""Queries on the map and off it: what the gate answers, and how well confidences find wrong answers."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.evaluation.confidences import CONFIDENCES
from offradar_ros.lab.evaluation.open_set_summary import PRECISIONS
from offradar_ros.lab.evaluation.results.open_set import ConfidenceFigures
from offradar_ros.lab.evaluation.table import number, with_interval
from offradar_ros.lab.report.labels import method_label, percent, spacing_label
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source

GATE_HEAD = (
    'method',
    'on the map',
    'off it',
    'R@1 (%)',
    'gate',
    'answered on the map (%)',
    'of clean scans (%)',
    'answered off it (%)',
    'wrong answers (%)',
    'right rejected (%)',
    'ECE of p_right',
    'Brier',
)
CONFIDENCE_HEAD = (
    'method',
    'confidence',
    'AUROC',
    'AUPR',
    *(f'right kept at {precision:g} (%)' for precision in PRECISIONS),
    *(f'off the map at {precision:g} (%)' for precision in PRECISIONS),
    'AURC',
    'AUGRC',
)


def open_set_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """What is answered on the map and off it, and each confidence as a detector of wrong answers."""
    methods = source.results.groups[group][spacing]
    where = f'{source.results.title(group)}, {spacing_label(spacing)}'
    scans = source.results.scans(group)
    yield TableSection(
        f'gate_{group}_{spacing}m',
        f'On the map and off it: {where}',
        'Queries are on the map if it holds a place within the tolerance. Gate: the rule that decides what is '
        'answered. Wrong answers: of all answers, those to queries off the map too. Right rejected: of the queries '
        f'whose nearest place is right; {scans}.',
        GATE_HEAD,
        tuple(_gate_row(source, group, spacing, name) for name in source.methods),
    )
    yield TableSection(
        f'confidence_{group}_{spacing}m',
        f'Confidence: {where}',
        'AUROC, with a 95 % bootstrap interval over pairs of drives, and AUPR of finding the answers that are wrong, '
        'off the map too. Right kept: share of the right answers that is still given at the lowest threshold at which '
        'the answers have this precision. Off the map: share of the queries off the map that is then answered. AURC, '
        f'AUGRC: areas under the risk–coverage curve and the generalised one, lower is better; {scans}.',
        CONFIDENCE_HEAD,
        tuple(
            (method_label(name), CONFIDENCES[confidence], *_confidence_cells(found))
            for name in source.methods
            for confidence, found in methods[name].open_set.confidences.items()
        ),
    )


def _gate_row(source: Source, group: str, spacing: str, method: str) -> tuple[str, ...]:
    figures = source.results.groups[group][spacing][method]
    found, gate = figures.open_set, figures.open_set.gate
    sign = '≥' if gate.rule == 'p_right' else '≤'
    return (
        method_label(method),
        str(found.on_map),
        str(found.off_map),
        percent(figures.recall_at_1.value),
        'none' if gate.rule == 'none' else f'{gate.rule} {sign} {number(gate.limit)}',
        *map(
            percent,
            (
                gate.answered_on_map,
                gate.answered_on_map_clean,
                gate.answered_off_map,
                gate.wrong,
                gate.right_rejected,
            ),
        ),
        number(found.ece),
        number(found.brier),
    )


def _confidence_cells(found: ConfidenceFigures) -> tuple[str, ...]:
    return (
        with_interval(found.auroc),
        number(found.average_precision),
        *(percent(at.right_kept) for at in found.at_precision),
        *(percent(at.off_map_answered) for at in found.at_precision),
        number(found.aurc),
        number(found.augrc),
    )
