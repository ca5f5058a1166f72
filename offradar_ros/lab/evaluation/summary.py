"""Answers to figures: what results say of one method on some pairs of drives.

Queries that no map could answer (no place within the tolerance) are left out of every figure but those under
`every_query`. `value` pools the scans of all pairs, so that one static scale of U is judged; `pairs` is
the mean of the figure over the pairs; `low` and `high` are a 95 % bootstrap interval over pairs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.metrics.auroc import auroc, auroc_of
from offradar_ros.lab.evaluation.metrics.binned_calibration import binned_calibration
from offradar_ros.lab.evaluation.metrics.bootstrap import bootstrap_interval
from offradar_ros.lab.evaluation.metrics.precision_recall import (
    PrecisionRecallCurve,
    precision_recall,
    precision_recall_of,
)
from offradar_ros.lab.evaluation.metrics.recall_at_n import recall_at_n
from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve, rejection_curve_of
from offradar_ros.lab.evaluation.metrics.sparsification import sparsification_error
from offradar_ros.lab.evaluation.metrics.spearman import spearman
from offradar_ros.lab.evaluation.metrics.tally import Tallier
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.thresholds import Thresholds

SEVERITIES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Edges of the bins that recall is told by; a severity on an edge is of the bin below."""

BETAS = (0.5, 1.0, 2.0)
"""Of F_β, over thresholds on the distance of the nearest place."""

Json = dict[str, Any]
Weighted = Callable[[NDArray[np.float64] | None], float]
"""A figure of some rows, given their weights."""

Statistic = Callable[['_Pooled'], Weighted]
"""Sorts rows once, for many weightings of them."""


class _Pooled:
    """The rows of several pairs, one after another."""

    def __init__(self, several: Sequence[Answers]) -> None:
        self.pair = np.repeat(np.arange(len(several)), [len(a.ranks) for a in several])
        self.uncertainties = np.concatenate([a.uncertainties for a in several])
        self.ranks: NDArray[np.int64] = np.concatenate([a.ranks for a in several])
        self.distances = np.concatenate([a.distances for a in several])
        self.positive = np.concatenate([a.positive for a in several])
        self.kinds = np.concatenate([a.kinds for a in several])
        self.severities = np.concatenate([a.severities for a in several])

    def where(self, chosen: NDArray[np.bool_]) -> _Pooled:
        part = object.__new__(_Pooled)
        part.__dict__ = {name: column[chosen] for name, column in self.__dict__.items()}
        return part

    @property
    def correct(self) -> NDArray[np.bool_]:
        right: NDArray[np.bool_] = self.ranks == 0
        return right


def summarise(several: Sequence[Answers], protocol: Protocol, thresholds: Thresholds) -> Json:
    """Figures of one method and one map spacing over `several` pairs (at least one), as JSON values."""
    every = _Pooled(several)
    rows = every.where(every.positive)

    def figure(statistic: Statistic, chosen: NDArray[np.bool_] | None = None) -> Json:
        return _figure(statistic, rows if chosen is None else rows.where(chosen), protocol)

    curve = rejection_curve(rows.uncertainties, rows.correct)
    kinds = sorted(set(rows.kinds.tolist()) - {''})
    judged = np.isfinite(rows.severities)
    return {
        'pairs': len(several),
        'queries': len(every.ranks),
        'with_positive': len(rows.ranks),
        'places': float(np.mean([a.places for a in several])),
        'recall_at_1': figure(_recall),
        'recall_at_1_clean': figure(_recall, rows.severities == 0.0),
        'recall_at_1_degraded': figure(_recall, rows.severities > 0.0),
        'recall_at_5': figure(_recall_at(5)),
        'recall_at_10': figure(_recall_at(10)),
        'every_query': {
            **{f'recall_at_{n}': recall_at_n(every.ranks, n) for n in (1, 5, 10)},
            'average_precision': _accepted_by_distance(every, len(rows.ranks))(None).average_precision,
        },
        'recall_at_1_by_kind': {kind: recall_at_n(rows.ranks[rows.kinds == kind], 1) for kind in kinds},
        'recall_at_1_by_severity': _by_severity(rows),
        'auroc_wrong': figure(_auroc_wrong),
        'auroc_wrong_by_severity': auroc(rows.severities[judged], ~rows.correct[judged]),
        'auroc_wrong_by_other_maps': _by_other_maps(several),
        'spearman_correct': spearman(rows.uncertainties, rows.correct),
        'recall_at_rejection': [[rejected, curve.recall_at(rejected)] for rejected in protocol.rejections],
        'recall_at_threshold': [_at_threshold(rows, threshold) for threshold in thresholds.static],
        'at_deployed_threshold': _deployed(every, rows, thresholds.deployed),
        'auc_recall_at_rejection': figure(_whole_area),
        'auc_recall_at_rejection_to_half': figure(_half_area),
        'average_precision': figure(_average_precision),
        'max_f_beta': max_f_beta(rows),
        'pair_level': _pair_level(several, protocol),
        'ausc': figure(_sparsification),
        'ause': sparsification_error(rows.uncertainties, rows.correct),
        'ece': binned_calibration(rows.uncertainties, rows.correct).error,
    }


def recognition(several: Sequence[Answers], protocol: Protocol) -> Json:
    """What a row of the paper's tables says of `several` pairs: Recall@1, 5 and 10, F_β and average precision."""
    every = _Pooled(several)
    rows = every.where(every.positive)
    return {
        **{f'recall_at_{n}': _figure(_recall_at(n), rows, protocol) for n in (1, 5, 10)},
        'max_f_beta': max_f_beta(rows),
        'average_precision': _figure(_average_precision, rows, protocol),
        'every_query': {'recall_at_1': recall_at_n(every.ranks, 1)},
    }


def _at_threshold(rows: _Pooled, threshold: float) -> Json:
    """Recall@1 of what one static threshold keeps; NaN where it keeps nothing."""
    kept = rows.uncertainties <= threshold
    share = float(kept.mean()) if len(kept) else math.nan
    recall = recall_at_n(rows.ranks[kept], 1)
    return {'threshold': threshold, 'rejected': 1.0 - share, 'kept': int(kept.sum()), 'recall_at_1': recall}


def _deployed(every: _Pooled, rows: _Pooled, threshold: float) -> Json:
    """The one threshold that is used: what it keeps of all queries, how much of that is right, and F_β.

    An answer to a query that no place could answer is wrong, and a rejected query that some place could have answered
    is missed.
    """
    if math.isnan(threshold):
        return {'threshold': math.nan}
    curve = precision_recall(every.uncertainties, every.correct, float(len(rows.ranks)))
    kept = every.uncertainties <= threshold
    return {
        **_at_threshold(rows, threshold),
        'rejected_of_every_query': 1.0 - float(kept.mean()),
        'precision': float(every.correct[kept].mean()) if kept.any() else math.nan,
        'f_beta': {f'{beta:g}': curve.f_beta_at(threshold, beta) for beta in BETAS},
    }


def _pair_level(several: Sequence[Answers], protocol: Protocol) -> Json:
    """Mean over the pairs of drives; the precision at recall 0, 0.01, …, 1."""
    several = [answers for answers in several if answers.pair_level]
    levels = [answers.pair_level for answers in several if answers.pair_level]
    found = np.array([level.average_precision for level in levels])
    known = np.flatnonzero(np.isfinite(found))
    if not len(known):
        return {'average_precision': {'value': math.nan, 'low': math.nan, 'high': math.nan}, 'precisions': []}
    # Searching A for B and B for A compares the same scans where every scan is mapped: not two pairs but one.
    roads = [(a.pair.group, a.pair.world, *sorted((a.pair.map_index, a.pair.query_index))) for a in several]
    ids = {road: number for number, road in enumerate(dict.fromkeys(roads))}
    low, high = bootstrap_interval(
        [ids[roads[row]] for row in known],
        lambda w: float(w @ found[known] / w.sum()),
        resamples=protocol.resamples,
        seed=protocol.seed,
    )
    mean = np.mean([levels[row].precisions for row in known], axis=0)
    return {
        'average_precision': {'value': float(found[known].mean()), 'low': low, 'high': high},
        'precisions': np.round(mean, 4).tolist(),
    }


def describe_uncertainty(several: Sequence[Answers]) -> Json:
    """U over the scans of the queries, each scan once, and how it follows the severity of what is wrong with them."""
    once = {_asked(a): a for a in reversed(several)}
    rows = _Pooled(list(once.values()))
    finite = rows.uncertainties[np.isfinite(rows.uncertainties)]
    judged = np.isfinite(rows.severities)
    kinds = sorted(set(rows.kinds.tolist()) - {''})
    within = {kind: rows.where(rows.kinds == kind) for kind in kinds}
    quantiles = np.quantile(finite, [0.0, 0.05, 0.5, 0.95, 1.0]).tolist() if len(finite) else [math.nan] * 5
    names = ('least', 'quantile_05', 'median', 'quantile_95', 'greatest')
    return {
        'scans': len(rows.ranks),
        'refused': len(rows.ranks) - len(finite),
        'mean': float(finite.mean()) if len(finite) else math.nan,
        **dict(zip(names, quantiles, strict=True)),
        'mean_by_kind': {
            kind or ('clean' if judged.any() else 'recorded'): _finite_mean(rows, kind) for kind in ['', *kinds]
        },
        'spearman_severity': {
            'all': spearman(rows.uncertainties[judged], rows.severities[judged]),
            **{kind: spearman(part.uncertainties, part.severities) for kind, part in within.items()},
        },
    }


def _finite_mean(rows: _Pooled, kind: str) -> float:
    values = rows.uncertainties[(rows.kinds == kind) & np.isfinite(rows.uncertainties)]
    return float(values.mean()) if len(values) else math.nan


def _figure(statistic: Statistic, rows: _Pooled, protocol: Protocol) -> Json:
    whole = statistic(rows)
    low, high = bootstrap_interval(rows.pair, whole, resamples=protocol.resamples, seed=protocol.seed)
    of_pairs = np.array([statistic(rows.where(rows.pair == pair))(None) for pair in np.unique(rows.pair)])
    known = of_pairs[np.isfinite(of_pairs)]
    mean = float(known.mean()) if len(known) else math.nan
    return {'value': whole(None), 'low': low, 'high': high, 'pairs': mean}


def _recall(rows: _Pooled) -> Weighted:
    return _recall_at(1)(rows)


def _recall_at(n: int) -> Statistic:
    return lambda rows: lambda weights: recall_at_n(rows.ranks, n, weights)


def _sparsification(rows: _Pooled) -> Weighted:
    area = _whole_area(rows)
    return lambda weights: 1.0 - area(weights)


def _auroc_wrong(rows: _Pooled) -> Weighted:
    tally = Tallier(rows.uncertainties, ~rows.correct)
    return lambda weights: auroc_of(tally(weights))


def _whole_area(rows: _Pooled) -> Weighted:
    tally = Tallier(rows.uncertainties, rows.correct)
    return lambda weights: rejection_curve_of(tally(weights)).mean_recall(1.0)


def _half_area(rows: _Pooled) -> Weighted:
    tally = Tallier(rows.uncertainties, rows.correct)
    return lambda weights: rejection_curve_of(tally(weights)).mean_recall(0.5)


def _average_precision(rows: _Pooled) -> Weighted:
    curve = _accepted_by_distance(rows)
    return lambda weights: curve(weights).average_precision


def _accepted_by_distance(
    rows: _Pooled, relevant: int | None = None
) -> Callable[[NDArray[np.float64] | None], PrecisionRecallCurve]:
    """One answer a query, its nearest place, accepted when near enough.

    So many of the queries have a place to be found; all of them if not given.
    """
    tally = Tallier(np.where(np.isfinite(rows.uncertainties), rows.distances, np.inf), rows.correct)

    def curve(weights: NDArray[np.float64] | None) -> PrecisionRecallCurve:
        tallied = tally(weights)
        return precision_recall_of(tallied, float(tallied.every.sum()) if relevant is None else float(relevant))

    return curve


def max_f_beta(rows: _Pooled) -> Json:
    """F_β over thresholds on the distance, and the distance of each."""
    curve = _accepted_by_distance(rows)(None)
    found = {f'{beta:g}': curve.max_f_beta(beta) for beta in BETAS}
    return {beta: {'value': value, 'distance': distance} for beta, (value, distance) in found.items()}


def _by_other_maps(several: Sequence[Answers]) -> float:
    """AUROC of how often the same scan is answered wrongly in the other maps of its world; NaN where there are none.

    A yardstick: how far being wrong follows the scan from map to map.
    """
    scores, wrong = [], []
    for answers in several:
        elsewhere = [other for other in several if other is not answers and _asked(other) == _asked(answers)]
        times = np.sum([other.positive for other in elsewhere], axis=0) * answers.positive
        failed = np.sum([other.positive & ~other.correct for other in elsewhere], axis=0)
        known = times > 0
        scores.append((failed / np.maximum(times, 1))[known])
        wrong.append(~answers.correct[known])
    return auroc(np.concatenate(scores), np.concatenate(wrong))


def _asked(answers: Answers) -> tuple[str, str, int]:
    return answers.pair.group, answers.pair.world, answers.pair.query_index


def _by_severity(rows: _Pooled) -> list[Json]:
    bins = []
    for low, high in itertools.pairwise(SEVERITIES):
        ranks = rows.ranks[(rows.severities > low) & (rows.severities <= high)]
        bins.append({'above': low, 'up_to': high, 'queries': len(ranks), 'recall_at_1': recall_at_n(ranks, 1)})
    return bins
