"""A model card from results: JSON for programs, Markdown for people. Every number is the results'."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.methods import OURS
from offradar_ros.lab.evaluation.protocol import ALL
from offradar_ros.lab.evaluation.results import spacing_key
from offradar_ros.lab.evaluation.summary import Json
from offradar_ros.lab.evaluation.table import number, with_interval

INTENDED_USE = (
    'Recognising places with a spinning radar of a ground vehicle on roads: maps made by `map_server_node`, queries '
    'answered or rejected by `query_node`. U ranks scans by how likely their answer is wrong; it is made to be '
    'compared with one static threshold.'
)
LIMITS = (
    'Learned and measured on simulated scans; recorded scans enter only where this card says so.',
    'Every kind of fault that it is measured with it was also trained with, and U was taught their severities.',
    'Where `validation.physics` of the training run is `held_out`, its checkpoint was chosen on other cities of that '
    'kind of radar: the kind is never trained on, but not unseen by the choice.',
    'The lanes that training drives were widened after searches on the real streets of the held-out protocol had '
    'failed across wide roads: nothing is trained on these streets, but they are not unseen by that choice.',
    'U sees what is wrong with a scan (noise, blocked sectors, saturation) and has learned what scenes are hard to '
    'find, not that a place was never mapped: a certain scan of an unmapped place is not rejected for its U.',
    'Calibrate (`offradar calibrate`) on an ordinary drive of the vehicle before using a threshold.',
    'No part of a safety function may rest on it.',
)


def card_json(results: Json) -> Json:
    """The figures for programs: over all groups, with the protocol's first map spacing."""
    spacing = headline_spacing(results)
    methods = results['groups'][ALL][spacing]
    maintenance = results['maintenance'][ALL][spacing].get(OURS)
    if OURS not in methods or maintenance is None:
        raise DataError('results: expected the method ours: run offradar evaluate with --method ours=WEIGHTS')

    def value(name: str) -> Json:
        return {method: figures[name]['value'] for method, figures in methods.items()}

    return {
        'recall_at_1': value('recall_at_1'),
        'recall_at_1_clean': value('recall_at_1_clean'),
        'auroc_wrong': value('auroc_wrong'),
        'auc_recall_at_rejection': value('auc_recall_at_rejection'),
        'recall_at_rejection': {method: figures['recall_at_rejection'] for method, figures in methods.items()},
        'spearman_severity': results['uncertainty'][ALL][OURS]['spearman_severity'],
        'map_maintenance': {name: maintenance[name] for name in ('O', 'M', 'M_random', 'Q', 'QM')},
        'worlds': results['worlds'],
        'seeds': results['seeds'],
        'command': results['command'],
    }


def headline_spacing(results: Json) -> str:
    """Key of the protocol's first map spacing."""
    return spacing_key(results['protocol']['map_spacings_m'][0])


def card_markdown(name: str, results: Json, weights: Path, fingerprint: str, training: Path | None) -> str:
    """The card of the weights of method ours; `fingerprint` is theirs, `training` the folder of the run
    that made them.

    DataError where the results are of other weights or the folder holds no configuration.
    """
    card_json(results)
    sections = [
        f'# {name}',
        _identity(results, weights, fingerprint),
        f'## Intended use\n\n{INTENDED_USE}',
        '## Limits\n\n' + '\n'.join(f'* {limit}' for limit in LIMITS),
        _data(results),
        '## Figures\n\n' + '\n\n'.join(_figures(results)),
        _uncertainty(results),
        _targets(results),
        '' if training is None else _training(training),
        '## How it was measured\n\n```\n' + results['command'] + '\n```\n\n' + _versions(results),
    ]
    return '\n\n'.join(section for section in sections if section) + '\n'


def _identity(results: Json, weights: Path, fingerprint: str) -> str:
    told = results['methods'][OURS]
    try:
        content = weights.read_bytes()
    except OSError as error:
        raise DataError(f'{weights}: cannot be read ({error.strerror})') from None
    if fingerprint != told['fingerprint']:
        raise DataError(
            f'{weights}: its fingerprint is {fingerprint[:12]}, the results are of {told["fingerprint"][:12]}'
        )
    rows = {
        'file': weights.name,
        'SHA-256': hashlib.sha256(content).hexdigest(),
        'size': f'{len(content) / 1e6:.1f} MB',
        'model fingerprint': told['fingerprint'],
        'dimension d': told['dimension'],
        'settings': f'`{told["settings"].get("settings", "")}`',
    }
    return _table(['', ''], [[key, str(value)] for key, value in rows.items()])


def _data(results: Json) -> str:
    protocol = results['protocol']
    lines = [
        '## Data',
        '',
        f'All drives are simulated, in worlds that no training sees; protocol `{protocol["name"]}`. A query is right '
        f'within {protocol["tolerance_m"]:g} m; {protocol["degraded"]:.0%} of the scans of every drive, mapped ones '
        'too, are degraded. Every ordered pair of drives of a world is searched.',
        '',
    ]
    lines += [f'* {group["name"]}: {group["title"]}; worlds {_worlds(group)}' for group in protocol['groups']]
    lines += [f'* left out: {text}' for text in results['skipped']]
    return '\n'.join(lines)


def _worlds(group: Json) -> str:
    return ', '.join([str(seed) for seed in group['cities']] + [street['name'] for street in group['streets']])


def _figures(results: Json) -> Iterator[str]:
    for group, spacings in results['groups'].items():
        for spacing, methods in spacings.items():
            rows = [
                [
                    method,
                    with_interval(figures['recall_at_1']),
                    with_interval(figures['recall_at_1_clean']),
                    with_interval(figures['auroc_wrong']),
                    number(figures['auroc_wrong_by_severity']),
                    number(figures.get('auroc_wrong_by_other_maps')),
                    with_interval(figures['auc_recall_at_rejection']),
                    ' '.join(number(recall) for _, recall in figures['recall_at_rejection'][:6]),
                ]
                for method, figures in methods.items()
            ]
            head = ['method', 'Recall@1', 'of clean scans', 'AUROC of U', 'of the true severity', 'of the other maps']
            head += ['area under Recall@RR', 'Recall@RR 0 to .5']
            yield f'### {group}, a map every {spacing} m\n\n' + _table(head, rows)
    rows = [
        [group, f'{spacing} m', *(number(told[OURS][name]) for name in ('O', 'M', 'M_random', 'Q', 'QM', 'rejected'))]
        for group, spacings in results['maintenance'].items()
        for spacing, told in spacings.items()
        if OURS in told
    ]
    head = ['worlds', 'map every', 'O', 'M', 'M, random', 'Q', 'QM', 'rejected by Q']
    yield '### Maintained maps (M) and introspective queries (Q)\n\n' + _table(head, rows)


def _uncertainty(results: Json) -> str:
    told = results['uncertainty'][ALL][OURS]
    quantile = results['protocol']['validation']['quantile']
    threshold = results['maintenance'][ALL][headline_spacing(results)][OURS]['threshold']
    text = (
        '## Calibration of U\n\n'
        f'The prior is at 1. Over {told["scans"]} scans U is {number(told["mean"])} on average, '
        f'{number(told["least"])} to {number(told["greatest"])}, and for 5 % of them above '
        f'{number(told["quantile_95"])}. The {quantile:g} quantile over clean validation drives, the static threshold '
        f'of Q and QM, is {number(threshold)}.\n\n'
    )
    correlations = told['spearman_severity']
    rows = [
        [kind, number(mean), number(correlations.get(kind))]
        for kind, mean in {**told['mean_by_kind'], 'all': told['mean']}.items()
    ]
    text += _table(['scans', 'mean U', 'Spearman of U with severity'], rows)
    if OURS in results.get('recorded', {}):
        rows = [
            [scans, str(u['scans']), number(u['mean']), f'{u["above_every_clean"]:.0%}']
            for scans, u in results['recorded'][OURS].items()
        ]
        head = ['recorded scans', 'number', 'mean U', 'above every clean scan']
        text += '\n\n' + _table(head, rows)
    return text


def _targets(results: Json) -> str:
    rows = [
        [
            str(t['target']),
            t['text'],
            ' '.join(filter(None, [t['group'], t['spacing_m'] and f'{t["spacing_m"]} m'])),
            t['wanted'],
            number(t['found']),
            'reached' if t['passed'] else '**missed**',
        ]
        for t in results.get('targets', [])
    ]
    return '## Targets\n\n' + _table(['', 'what', 'where', 'wanted', 'found', ''], rows) if rows else ''


def _training(folder: Path) -> str:
    path = folder / 'config.yaml'
    try:
        text = path.read_text(encoding='utf-8')
        yaml.safe_load(text)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise DataError(f'{path}: expected the configuration of a training run ({error})') from None
    return f'## Training\n\n```yaml\n{text.strip()}\n```'


def _versions(results: Json) -> str:
    told = ', '.join(f'{name} {version}' for name, version in results['versions'].items())
    return f'{results["created"]}: {told}. Intervals are 95 % bootstrap intervals over pairs of drives.'


def _table(head: list[str], rows: list[list[Any]]) -> str:
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join('| ' + ' | '.join(str(cell).replace('|', '\\|') for cell in line) + ' |' for line in lines)
