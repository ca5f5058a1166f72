"""What the measured encoder is held to, and whether it gets there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from offradar_ros.lab.evaluation.methods import OURS
from offradar_ros.lab.evaluation.summary import Json

CLEAN_RECALL = 0.98
AUROC = 0.95
SPEARMAN = 0.7
SPEARMAN_WITHIN = 0.5
STEPS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
UNSURE_METHODS = ('stun', 'stun_free', 'mc_dropout', 'vae')
"""Whose area under the Recall@RR curve ours has to exceed."""


def targets(results: Json, ours: str = OURS) -> list[Json]:
    """Every target of `ours` that the results can tell of: number, text, group, spacing, wanted, found, passed.

    `wanted` reads ``≥ 0.95`` or ``> 0.812``; spacing is empty where maps do not matter.
    """
    if ours not in results['methods']:
        return []
    return [
        *_recall(results, ours),
        *_rejection(results, ours),
        *_maintenance(results, ours),
        *_severity(results, ours),
    ]


def recorded_targets(recorded: Json, ours: str = OURS) -> list[Json]:
    """U of spoiled and foggy recorded scans against that of the clean ones."""
    told = recorded.get(ours, {})
    clean = told.get('clean', {}).get('mean', math.nan)
    return [
        _target(5, f'mean U of recorded scans: {name} above clean', '', '', '>', clean, figures['mean'])
        for name, figures in told.items()
        if name != 'clean'
    ]


def _recall(results: Json, ours: str) -> Iterator[Json]:
    for group, spacings in results['groups'].items():
        for number, (spacing, methods) in enumerate(spacings.items()):
            own = methods[ours]
            for name, figures in methods.items():
                if name != ours:
                    wanted, found = figures['recall_at_1']['value'], own['recall_at_1']['value']
                    yield _target(1, f'Recall@1 at least that of {name}', group, spacing, '≥', wanted, found)
            if number == 0:
                found = own['recall_at_1_clean']['value']
                yield _target(1, 'Recall@1 of clean scans', group, spacing, '≥', CLEAN_RECALL, found)


def _rejection(results: Json, ours: str) -> Iterator[Json]:
    for group, spacings in results['groups'].items():
        for spacing, methods in spacings.items():
            own = methods[ours]
            yield _target(2, 'AUROC of U for wrong answers', group, spacing, '≥', AUROC, own['auroc_wrong']['value'])
            curve = {round(rejected, 6): recall for rejected, recall in own['recall_at_rejection']}
            steps = [curve[step] for step in STEPS if step in curve]
            # Nothing can rise above 1.
            gains = [math.inf if high == 1.0 else high - low for low, high in itertools.pairwise(steps)]
            least = min(gains, default=math.nan)
            yield _target(2, 'Recall@RR rises at every step of 0.1 up to 0.5', group, spacing, '>', 0.0, least)
            for name in UNSURE_METHODS:
                if name in methods:
                    key = 'auc_recall_at_rejection'
                    wanted, found = methods[name][key]['value'], own[key]['value']
                    yield _target(2, f'area under Recall@RR above that of {name}', group, spacing, '>', wanted, found)


def _maintenance(results: Json, ours: str) -> Iterator[Json]:
    for group, spacings in results['maintenance'].items():
        for spacing, methods in spacings.items():
            if ours in methods:
                told = methods[ours]
                for better, worse in (('M', 'O'), ('M', 'M_random'), ('QM', 'Q')):
                    yield _target(3, f'{better} above {worse}', group, spacing, '>', told[worse], told[better])


def _severity(results: Json, ours: str) -> Iterator[Json]:
    for group, methods in results['uncertainty'].items():
        for kind, found in methods[ours]['spearman_severity'].items():
            wanted = SPEARMAN if kind == 'all' else SPEARMAN_WITHIN
            text = f'Spearman of U with severity, {"all scans" if kind == "all" else kind}'
            yield _target(4, text, group, '', '≥', wanted, found)


def _target(number: int, text: str, group: str, spacing: str, sign: str, wanted: float, found: float) -> Json:
    passed = found >= wanted if sign == '≥' else found > wanted
    return {
        'target': number,
        'text': text,
        'group': group,
        'spacing_m': spacing,
        'wanted': f'{sign} {wanted:.3f}',
        'found': found,
        'passed': bool(passed),
    }
