"""Tables of a report, from results alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from offradar_ros.evaluation.methods import OURS
from offradar_ros.evaluation.report.paper_tables import PAPER_TABLES, PAPER_TITLES, PaperRow
from offradar_ros.evaluation.report.sections import TableSection
from offradar_ros.evaluation.report.source import Source
from offradar_ros.evaluation.summary import Json
from offradar_ros.evaluation.table import number, with_interval

RECOGNITION_HEAD = (
    'method',
    'R@1 (%)',
    'R@5 (%)',
    'R@10 (%)',
    'F1',
    'F0.5',
    'F2',
    'AP',
    'R@1 of all (%)',
    'AP of pairs',
)
NAMES = {
    'bc_radar': 'BCRadar',
    'vae': 'VAE',
    'ring_key': 'RingKey',
    'stun': 'STUN',
    'mc_dropout': 'MC Dropout',
    'rad_vlad': 'FFT-RadVLAD',
    OURS: 'OURS(O)',
    f'{OURS} (M)': 'OURS(M)',
}


def all_tables(source: Source) -> Iterator[TableSection]:
    """Every table, those of the paper's form first."""
    for group in source.groups:
        for spacing in source.spacings:
            yield recognition_table(source, group, spacing)
    if not any(group['paper'] for group in source.results['protocol']['groups']):
        for which in PAPER_TABLES:
            yield paper_table(which)
    yield from ablation_tables(source)
    for group in source.groups:
        for spacing in source.spacings:
            yield uncertainty_table(source, group, spacing)
            yield deployed_table(source, group, spacing)
            yield from threshold_tables(source, group, spacing)
    yield cost_table(source)
    if source.results.get('recorded'):
        yield recorded_table(source)
    if source.results['targets']:
        yield targets_table(source)


def recognition_table(source: Source, group: str, spacing: str) -> TableSection:
    """The paper's form: Recall@1, 5, 10, F_β and AP; OURS(M) where maps were maintained; the paper's own beside."""
    methods = source.results['groups'][group][spacing]
    rows: dict[str, Json] = {name: methods[name] for name in source.methods}
    maintained = source.results['maintenance'].get(group, {}).get(spacing, {}).get(OURS)
    if maintained:
        rows[f'{OURS} (M)'] = maintained['figures']['M']
    which = _paper_of(source, group)
    paper = PAPER_TABLES.get(which, {})
    columns = [_recognition(figures) for figures in rows.values()]
    best = [_places(column) for column in zip(*columns, strict=True)]
    cells = []
    for row, name in enumerate(rows):
        own = [_ranked(text, places[row]) for text, places in zip(columns[row], best, strict=True)]
        cells.append((NAMES.get(name, name), *own, *(_paper_cells(paper.get(name)) if paper else ())))
    first = next(iter(methods.values()))
    beside = f' Right columns: {PAPER_TITLES[which]}, F as printed there' if paper else ''
    if paper and source.data_word(group) != 'recorded scans':
        beside += '; of recorded scans and the networks of the paper, not of what is measured here'
    return TableSection(
        f'recognition_{group}_{spacing}m',
        f'Recognition: {source.title(group)}, {_map_words(spacing)}',
        f'Pooled over {first["with_positive"]} of {first["queries"]} queries, those that have a right place in the '
        f'map, of {first["pairs"]} ordered pairs of drives; {source.data_word(group)}. F is the highest over '
        'thresholds on the distance of the nearest place, for each β by itself; AP over the same, one answer a query. '
        'R@1 of all counts every query: one without a right place is always wrong. AP of pairs is of every query with '
        f'every place. **Best**, _second_.{beside}{"." if beside else ""}',
        RECOGNITION_HEAD + (tuple(f'paper: {name}' for name in PAPER_HEAD) if paper else ()),
        tuple(cells),
    )


PAPER_HEAD = ('R@1/5/10', 'F (as printed)', 'AP')


def paper_table(which: int) -> TableSection:
    """One of the paper's tables by itself."""
    rows = tuple((NAMES.get(name, name), *_paper_cells(row)) for name, row in PAPER_TABLES[which].items())
    return TableSection(
        f'paper_table_{which}',
        f'For reference: {PAPER_TITLES[which]}',
        "The paper's own figures, of its own networks on recorded scans: not of the data measured here, and not to be "
        'compared with it. Its F columns are in no order one standard F_β.',
        ('method', *PAPER_HEAD),
        rows,
    )


def _name(method: str) -> str:
    """Where no ablation is spoken of."""
    return NAMES.get(method, method).replace('(O)', '')


def _paper_of(source: Source, group: str) -> int:
    return next((int(g['paper']) for g in source.results['protocol']['groups'] if g['name'] == group), 0)


def _paper_cells(row: PaperRow | None) -> tuple[str, ...]:
    if row is None:
        return ('-',) * len(PAPER_HEAD)
    printed = ' / '.join(f'{value:.2f}' for value in row.f_printed)
    recalls = ' / '.join(f'{value:.2f}' for value in (row.recall_at_1, row.recall_at_5, row.recall_at_10))
    return recalls, printed, f'{row.average_precision:.2f}'


def _recognition(figures: Json) -> list[str]:
    recalls = [_value(figures[f'recall_at_{n}']) for n in (1, 5, 10)]
    f_beta = [figures['max_f_beta'][beta]['value'] for beta in ('1', '0.5', '2')]
    paired = figures.get('pair_level', {}).get('average_precision', {}).get('value')
    every = figures['every_query']['recall_at_1']
    precision = _value(figures['average_precision'])
    return [*map(_percent, recalls), *map(number, [*f_beta, precision]), _percent(every), number(paired)]


def _value(figure: Json | float | None) -> float | None:
    return figure['value'] if isinstance(figure, dict) else figure


def _percent(value: float | None) -> str:
    return '-' if value is None or math.isnan(value) else f'{100.0 * value:.2f}'


def _places(column: Sequence[str]) -> list[int]:
    """0 for the best of a column, 1 for the second, and so on; equal ones share a place."""
    known = sorted({float(text) for text in column if text != '-'}, reverse=True)
    return [known.index(float(text)) if text != '-' else len(known) for text in column]


def _ranked(text: str, place: int) -> str:
    return f'**{text}**' if place == 0 else f'_{text}_' if place == 1 else text


def _map_words(spacing: str) -> str:
    return 'every scan mapped' if float(spacing) == 0.0 else f'a map every {spacing} m'


def ablation_tables(source: Source) -> Iterator[TableSection]:
    """O, M, M_random, Q and QM of every method that has them."""
    names = ('O', 'M', 'M_random', 'Q', 'QM')
    for group in source.groups:
        for spacing, methods in source.results['maintenance'].get(group, {}).items():
            if methods:
                rows = tuple(
                    (
                        _name(method),
                        *(_percent(methods[method][name]) for name in names),
                        _percent(methods[method]['rejected']),
                        number(methods[method]['threshold']),
                        f'{methods[method]["replaced"]} of {methods[method]["opportunities"]}',
                    )
                    for method in source.methods
                    if method in methods
                )
                yield TableSection(
                    f'ablation_{group}_{spacing}m',
                    f'Ablation: {source.title(group)}, {_map_words(spacing)}',
                    'Recall@1 in %. O: the map of one drive; M: all drives but that and the query are merged into it; '
                    'M_random: as many replacements, drawn at random; Q, QM: the same of the queries whose U is at '
                    f'most the threshold; {source.data_word(group)}.',
                    ('method', *names, 'rejected (%)', 'threshold', 'replacements'),
                    rows,
                )


def uncertainty_table(source: Source, group: str, spacing: str) -> TableSection:
    """What U is worth."""
    methods = source.results['groups'][group][spacing]
    shares = [share for share, _ in next(iter(methods.values()))['recall_at_rejection']]
    cells: dict[str, Callable[[Json], str]] = {
        'AUROC of U': lambda f: with_interval(f['auroc_wrong']),
        'area under Recall@RR': lambda f: with_interval(f['auc_recall_at_rejection']),
        'AUSC': lambda f: number(f['ausc']),
        'AUSE': lambda f: number(f['ause']),
        'ECE': lambda f: number(f['ece']),
    }
    return TableSection(
        f'uncertainty_{group}_{spacing}m',
        f'Uncertainty: {source.title(group)}, {_map_words(spacing)}',
        'AUROC: chance that a wrong answer has the higher U. RR 0 to 0.9: Recall@RR, Recall@1 (%) of what is left when '
        'so great a share is rejected, the most uncertain first. AUSC, AUSE, ECE: lower is better. With '
        f'95 % bootstrap intervals over pairs of drives; {source.data_word(group)}.',
        ('method', *cells, *(f'RR {share:g}' for share in shares)),
        tuple(
            (
                _name(name),
                *(cell(methods[name]) for cell in cells.values()),
                *(_percent(recall) for _, recall in methods[name]['recall_at_rejection']),
            )
            for name in source.methods
        ),
    )


def deployed_table(source: Source, group: str, spacing: str) -> TableSection:
    """What the one threshold in use does."""
    rows = []
    for name in source.methods:
        told = source.results['groups'][group][spacing][name]['at_deployed_threshold']
        if told.get('threshold') is not None:
            f_beta = (number(told['f_beta'][beta]) for beta in ('1', '0.5', '2'))
            shares = (told['rejected'], told['recall_at_1'], told['precision'])
            label = _name(name)
            rows.append((label, number(told['threshold']), *map(_percent, shares), *f_beta))
    return TableSection(
        f'deployed_{group}_{spacing}m',
        f'The threshold in use: {source.title(group)}, {_map_words(spacing)}',
        'Rejected: share of the queries that have a right place (%). Recall@1 of those that are answered (%). '
        'Precision (%) and F count every query: an answer where no place is right is wrong, a rejected query that has '
        f'a right place is missed; {source.data_word(group)}.',
        ('method', 'threshold', 'rejected (%)', 'R@1 of the answered (%)', 'precision (%)', 'F1', 'F0.5', 'F2'),
        tuple(rows),
    )


def threshold_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """Recall@1 of what each static threshold keeps, of the method that is shown."""
    told = source.results['groups'][group][spacing][source.shown]['recall_at_threshold']
    # Of those that keep nothing the highest is enough.
    told = told[max(0, sum(row['kept'] == 0 for row in told) - 1) :]
    if told:
        yield TableSection(
            f'thresholds_{group}_{spacing}m',
            f'Static thresholds of {_name(source.shown)}: {source.title(group)}, {_map_words(spacing)}',
            'T = (1 − Δ) + n · 2Δ/N, Δ the largest |U − 1| of the validation drives. Lower ones than the first keep '
            f'nothing, and have no recall; {source.data_word(group)}.',
            ('T', 'rejected (%)', 'kept', 'R@1 (%)'),
            tuple(
                (number(row['threshold']), _percent(row['rejected']), str(row['kept']), _percent(row['recall_at_1']))
                for row in told
            ),
        )


def cost_table(source: Source) -> TableSection:
    """Time and memory of every method."""
    rows = []
    for name in source.methods:
        told = source.results['methods'][name]
        cost = told['cost']
        numbers = [cost['encode_ms'], cost['search_ms'], cost['bytes_a_place'] / 1000.0, cost['peak_memory_mb']]
        texts = ('-' if value is None else f'{value:.3g}' for value in numbers)
        rows.append((_name(name), str(told['dimension']), *texts))
    return TableSection(
        'cost',
        'Cost',
        'Medians on the machine of this evaluation: encoding one scan from its polar image, finding ten places in a '
        'map of the mean size, memory of a descriptor, peak of the whole process until then.',
        ('method', 'dimension', 'encode (ms)', 'search (ms)', 'a place (kB)', 'peak memory (MB)'),
        tuple(rows),
    )


def recorded_table(source: Source) -> TableSection:
    """U of recorded scans, clean and spoiled."""
    told = source.results['recorded']
    kinds = list(next(iter(told.values())))
    rows = tuple((_name(name), *(number(told[name][kind]['mean']) for kind in kinds)) for name in source.methods)
    return TableSection(
        'recorded_scans',
        'U of recorded scans',
        'Mean U of recorded scans of Oxford Radar RobotCar as they are and spoiled, and of RADIATE in fog.',
        ('method', *kinds),
        rows,
    )


def targets_table(source: Source) -> TableSection:
    """What the weights that ship are held to."""
    rows = tuple(
        (
            t['text'],
            ' '.join(filter(None, [t['group'], t['spacing_m'] and f'{t["spacing_m"]} m'])),
            t['wanted'],
            number(t['found']),
            'reached' if t['passed'] else '**missed**',
        )
        for t in source.results['targets']
    )
    return TableSection('targets', 'Targets', 'Of method ours.', ('what', 'where', 'wanted', 'found', ''), rows)
