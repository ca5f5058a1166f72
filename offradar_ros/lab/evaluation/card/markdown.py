"""A card as Markdown: every sentence follows from what was measured, or is a remark of the author."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from offradar_ros.lab.evaluation.card.card import Card, CardFigures
from offradar_ros.lab.evaluation.confidences import CONFIDENCES
from offradar_ros.lab.evaluation.protocol import Group
from offradar_ros.lab.evaluation.results.ablation import CASES
from offradar_ros.lab.evaluation.table import number, with_interval

SHARES = 6
"""Number of points of Recall@RR that are shown."""

HEAD = (
    'method',
    'Recall@1',
    'of clean scans',
    'AUROC of U',
    'of the true severity',
    'of the other maps',
    'area under Recall@RR',
    'Recall@RR 0 to .5',
)

GATE_HEAD = (
    'worlds, map every',
    'on the map',
    'off it',
    'gate',
    'answered on the map',
    'of clean scans',
    'answered off it',
    'wrong answers',
    'ECE of p_right',
    'Brier',
)
CONFIDENCE_HEAD = (
    'worlds, map every',
    'confidence',
    'AUROC of wrong or off the map',
    'AUPR',
    'right answers kept at precision .95, .99, .999',
    'answered off the map',
    'AURC',
    'AUGRC',
)


def card_markdown(card: Card) -> str:
    """The whole page."""
    sections = [
        f'# {card.name}',
        _identity(card),
        card.remarks.strip(),
        _data(card),
        '## Figures\n\n' + '\n\n'.join(_figures(card)),
        '\n\n'.join(_open_set(card)),
        _uncertainty(card),
        f'## Training\n\n```yaml\n{card.training}\n```' if card.training else '',
        _origin(card),
    ]
    return '\n\n'.join(section for section in sections if section) + '\n'


def _identity(card: Card) -> str:
    weights = card.weights
    rows = {
        'file': weights.file,
        'SHA-256': weights.sha256,
        'size': f'{weights.size_bytes / 1e6:.1f} MB',
        'model fingerprint': weights.fingerprint,
        'dimension d': weights.dimension,
        'settings': f'`{weights.settings}`',
    }
    return _table(['', ''], [[key, str(value)] for key, value in rows.items()])


def _data(card: Card) -> str:
    protocol = card.protocol
    measured = [group for group in protocol.groups if group.name in card.groups]
    simulated = any(group.simulated for group in measured)
    lines = [
        '## Data',
        '',
        f'Measured with the protocol `{protocol.name}` on {_drives(measured)}. A query is right within '
        f'{protocol.tolerance_m:g} m. Every ordered pair of drives of a world is searched'
        + (', and every drive in its own map.' if protocol.exclusion_s > 0.0 else '.')
        + (' A part of the road is left out of each map.' if protocol.leaves_out else ''),
        '',
    ]
    lines += [f'* {group.name}: {group.title}; {group.scans}; worlds {_worlds(group)}' for group in measured]
    lines += [f'* left out: {text}' for text in card.skipped]
    if simulated:
        lines += ['', _faults(card)]
    if math.isnan(card.threshold):
        lines += ['', 'No threshold was in use: of Q and QM nothing is known.']
    return '\n'.join(lines)


def _drives(groups: Sequence[Group]) -> str:
    kinds = {group.scans for group in groups}
    if kinds == {'simulated scans'}:
        return 'simulated drives only'
    return 'recorded drives only' if kinds == {'recorded scans'} else 'simulated and recorded drives'


def _faults(card: Card) -> str:
    kinds = [kind for kind in card.uncertainty.mean_by_kind if kind not in ('clean', 'recorded')]
    if not kinds:
        return 'No scan is degraded: nothing is known of how faults change these figures.'
    return (
        f'The simulation degrades {card.protocol.degraded:.0%} of the scans of its drives, mapped ones too: '
        f'{", ".join(kinds)}. Of other faults nothing is known.'
    )


def _worlds(group: Group) -> str:
    streets, roads = [street.name for street in group.streets], [road.name for road in group.recorded]
    return ', '.join([*map(str, group.cities), *streets, *roads])


def _figures(card: Card) -> Iterator[str]:
    for group, spacings in card.groups.items():
        for spacing, methods in spacings.items():
            rows = [[method, *_row(figures)] for method, figures in methods.items()]
            yield f'### {group}, a map every {spacing} m\n\n' + _table(HEAD, rows)
    rows = [
        [group, f'{spacing} m', *(number(found.recall_at_1[case]) for case in CASES), number(found.rejected)]
        for group, spacings in card.maintenance.items()
        for spacing, found in spacings.items()
    ]
    if rows:
        head = ['worlds', 'map every', 'O', 'M', 'M, random', 'Q', 'QM', 'rejected by Q']
        yield '### Maintained maps (M) and introspective queries (Q)\n\n' + _table(head, rows)


def _row(figures: CardFigures) -> list[str]:
    return [
        with_interval(figures.recall_at_1),
        with_interval(figures.recall_at_1_clean),
        with_interval(figures.auroc_wrong),
        number(figures.auroc_wrong_by_severity),
        number(figures.auroc_wrong_by_other_maps),
        with_interval(figures.auc_recall_at_rejection),
        ' '.join(number(recall) for _, recall in figures.recall_at_rejection[:SHARES]),
    ]


def _open_set(card: Card) -> Iterator[str]:
    found = [(f'{group}, {spacing} m', one) for group, by in card.open_set.items() for spacing, one in by.items()]
    if not found:
        return
    yield (
        '## On the map and off it\n\nA query is on the map if it holds a place within the tolerance; every answer to '
        'another is wrong.' + (f' Measured by `{card.open_set_command}`.' if card.open_set_command else '')
    )
    rows = []
    for name, one in found:
        gate = one.gate
        answered = (gate.answered_on_map, gate.answered_on_map_clean, gate.answered_off_map, gate.wrong)
        limit = '' if gate.rule == 'none' else f' {number(gate.limit)}'
        cells = [str(one.on_map), str(one.off_map), f'{gate.rule}{limit}']
        rows.append([name, *cells, *map(number, (*answered, one.ece, one.brier))])
    yield _table(GATE_HEAD, rows)
    yield _table(
        CONFIDENCE_HEAD,
        [
            [
                name,
                CONFIDENCES[confidence],
                with_interval(figures.auroc),
                number(figures.average_precision),
                ', '.join(number(at.right_kept) for at in figures.at_precision),
                ', '.join(number(at.off_map_answered) for at in figures.at_precision),
                number(figures.aurc),
                number(figures.augrc),
            ]
            for name, one in found
            for confidence, figures in one.confidences.items()
        ],
    )


def _uncertainty(card: Card) -> str:
    found = card.uncertainty
    text = (
        '## Calibration of U\n\n'
        f'The prior is at 1. Over {found.scans} scans U is {number(found.mean)} on average, '
        f'{number(found.least)} to {number(found.greatest)}, and for 5 % of them above {number(found.quantile_95)}.'
    )
    if not math.isnan(card.threshold):
        text += f' The static threshold of Q and QM is {number(card.threshold)}{_threshold_source(card)}.'
    rows = [
        [kind, number(mean), number(card.spearman_severity.get(kind, math.nan))]
        for kind, mean in {**found.mean_by_kind, 'all': found.mean}.items()
    ]
    text += '\n\n' + _table(['scans', 'mean U', 'Spearman of U with severity'], rows)
    if card.recorded:
        recorded = card.recorded
        rows = [
            [scans, str(u.scans), number(u.mean), f'{u.above_every_clean:.0%}']
            for scans, u in recorded.methods[card.method].items()
        ]
        names = ''.join(f'; {condition}: {name}' for condition, name in recorded.compared.items())
        text += f'\n\nRecorded scans of {recorded.clean}, as they are and degraded on their bytes{names}:\n\n'
        text += _table(['recorded scans', 'number', 'mean U', 'above every clean scan'], rows)
    return text


def _threshold_source(card: Card) -> str:
    validation = card.protocol.validation
    if not validation.cities and not validation.sequences:
        return ', as it was given'
    return f', the {validation.quantile:g} quantile over clean validation drives'


def _origin(card: Card) -> str:
    versions = ', '.join(f'{name} {version}' for name, version in card.versions.items())
    return (
        f'## How it was measured\n\n```\n{card.command}\n```\n\n'
        f'{card.created}: {versions}. Intervals are 95 % bootstrap intervals over pairs of drives.\n\n'
        f'## How this card was made\n\n```\n{card.card_command}\n```\n\n'
        f'`offradar card {card.name}.card.json` writes this page again from the figures beside it.'
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join('| ' + ' | '.join(cell.replace('|', '\\|') for cell in line) + ' |' for line in lines)
