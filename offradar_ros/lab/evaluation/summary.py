"""Figures of one method over some pairs of drives.

Queries without a positive (no place of the map within the tolerance) are left out of all figures but `every_query`,
`at_deployed_threshold` and `open_set`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.evaluation.answers import Answers, pair_numbers
from offradar_ros.lab.evaluation.gate import Gate
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
from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter
from offradar_ros.lab.evaluation.metrics.sparsification import sparsification_error
from offradar_ros.lab.evaluation.metrics.spearman import spearman
from offradar_ros.lab.evaluation.open_set_summary import summarise_open_set
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.results.figure import Figure, Interval
from offradar_ros.lab.evaluation.results.recognition import BestFBeta, EveryQuery, Recognition
from offradar_ros.lab.evaluation.results.search import (
    AtDeployedThreshold,
    AtThreshold,
    PairLevelFigures,
    SearchFigures,
    SeverityBin,
)
from offradar_ros.lab.evaluation.results.uncertainty import UncertaintyFigures
from offradar_ros.lab.evaluation.thresholds import Thresholds

SEVERITIES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Edges of the bins of recall by severity; a severity on an edge belongs to the bin below."""

BETAS = (0.5, 1.0, 2.0)
"""The β of each F_β."""

Weighted = Callable[[NDArray[np.float64] | None], float]
"""A figure of some rows as a function of their weights, (N,) or None for equal ones."""

Statistic = Callable[['_Pooled'], Weighted]
"""Sorts the rows once, and returns their figure as a function of weights."""


class _Pooled:
    """The queries of several pairs, concatenated."""

    def __init__(self, several: Sequence[Answers]) -> None:
        self.pair = pair_numbers(several)
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
        correct: NDArray[np.bool_] = self.ranks == 0
        return correct


def summarise(several: Sequence[Answers], protocol: Protocol, thresholds: Thresholds, gate: Gate) -> SearchFigures:
    """Figures of one method and one map spacing over `several` pairs (at least one)."""
    every = _Pooled(several)
    rows = every.where(every.positive)

    def figure(statistic: Statistic, chosen: NDArray[np.bool_] | None = None) -> Figure:
        return _figure(statistic, rows if chosen is None else rows.where(chosen), protocol)

    curve = rejection_curve(rows.uncertainties, rows.correct)
    kinds = sorted(set(rows.kinds.tolist()) - {''})
    known = np.isfinite(rows.severities)
    return SearchFigures(
        **vars(_recognition(every, rows, protocol)),
        pairs=len(np.unique(every.pair)),
        queries=len(every.ranks),
        with_positive=len(rows.ranks),
        places=float(np.mean([a.places for a in several])),
        recall_at_1_clean=figure(_recall_at(1), rows.severities == 0.0),
        recall_at_1_degraded=figure(_recall_at(1), rows.severities > 0.0),
        recall_at_1_by_kind={kind: recall_at_n(rows.ranks[rows.kinds == kind], 1) for kind in kinds},
        recall_at_1_by_severity=_by_severity(rows),
        auroc_wrong=figure(_auroc_wrong),
        auroc_wrong_by_severity=auroc(rows.severities[known], ~rows.correct[known]),
        auroc_wrong_by_other_maps=_by_other_maps(several),
        spearman_correct=spearman(rows.uncertainties, rows.correct),
        recall_at_rejection=tuple((rejected, curve.recall_at(rejected)) for rejected in protocol.rejections),
        recall_at_threshold=tuple(_at_threshold(rows, threshold) for threshold in thresholds.static),
        at_deployed_threshold=_deployed(every, rows, thresholds.deployed),
        auc_recall_at_rejection=figure(_whole_area),
        auc_recall_at_rejection_to_half=figure(_half_area),
        pair_level=_pair_level(several, protocol),
        ausc=figure(_sparsification),
        ause=sparsification_error(rows.uncertainties, rows.correct),
        ece=binned_calibration(rows.uncertainties, rows.correct).error,
        open_set=summarise_open_set(several, gate, protocol),
    )


def recognition(several: Sequence[Answers], protocol: Protocol) -> Recognition:
    """The figures of the paper's tables over `several` pairs."""
    every = _Pooled(several)
    return _recognition(every, every.where(every.positive), protocol)


def _recognition(every: _Pooled, rows: _Pooled, protocol: Protocol) -> Recognition:
    ranks = every.ranks if len(rows.ranks) else rows.ranks
    return Recognition(
        recall_at_1=_figure(_recall_at(1), rows, protocol),
        recall_at_5=_figure(_recall_at(5), rows, protocol),
        recall_at_10=_figure(_recall_at(10), rows, protocol),
        average_precision=_figure(_average_precision, rows, protocol),
        max_f_beta=max_f_beta(rows),
        every_query=EveryQuery(
            recall_at_1=recall_at_n(ranks, 1),
            recall_at_5=recall_at_n(ranks, 5),
            recall_at_10=recall_at_n(ranks, 10),
            average_precision=_accepted_by_distance(every, len(rows.ranks))(None).average_precision,
        ),
    )


def _at_threshold(rows: _Pooled, threshold: float) -> AtThreshold:
    """Recall@1 of the queries that one static threshold accepts; NaN if it accepts none."""
    kept = rows.uncertainties <= threshold
    share = float(kept.mean()) if len(kept) else math.nan
    return AtThreshold(threshold, 1.0 - share, int(kept.sum()), recall_at_n(rows.ranks[kept], 1))


def _deployed(every: _Pooled, rows: _Pooled, threshold: float) -> AtDeployedThreshold | None:
    """Figures at the threshold in use; None without one."""
    if math.isnan(threshold):
        return None
    curve = precision_recall(every.uncertainties, every.correct, float(len(rows.ranks)))
    kept = every.uncertainties <= threshold
    return AtDeployedThreshold(
        **vars(_at_threshold(rows, threshold)),
        rejected_of_every_query=1.0 - float(kept.mean()),
        precision=float(every.correct[kept].mean()) if kept.any() else math.nan,
        f_beta={f'{beta:g}': curve.f_beta_at(threshold, beta) for beta in BETAS},
    )


def _pair_level(several: Sequence[Answers], protocol: Protocol) -> PairLevelFigures:
    """The mean over the pairs of drives."""
    several = [answers for answers in several if answers.pair_level]
    levels = [answers.pair_level for answers in several if answers.pair_level]
    found = np.array([level.average_precision for level in levels])
    known = np.flatnonzero(np.isfinite(found))
    if not len(known):
        return PairLevelFigures(Interval(math.nan, math.nan, math.nan), ())
    # With every scan mapped, A in the map of B and B in the map of A compare the same scans: they are drawn together.
    roads = [(a.pair.group, a.pair.world, *sorted((a.pair.map_index, a.pair.query_index))) for a in several]
    ids = {road: number for number, road in enumerate(dict.fromkeys(roads))}
    low, high = bootstrap_interval(
        [ids[roads[row]] for row in known],
        lambda w: float(w @ found[known] / w.sum()),
        resamples=protocol.resamples,
        seed=protocol.seed,
    )
    mean: NDArray[np.float64] = np.mean([levels[row].precisions for row in known], axis=0)
    return PairLevelFigures(Interval(float(found[known].mean()), low, high), tuple(np.round(mean, 4).tolist()))


def describe_uncertainty(several: Sequence[Answers]) -> UncertaintyFigures:
    """U over the query scans, each scan once, and its correlation with severity."""
    once = {_query_drive(a): a for a in reversed(several)}
    rows = _Pooled(list(once.values()))
    finite = rows.uncertainties[np.isfinite(rows.uncertainties)]
    known = np.isfinite(rows.severities)
    kinds = sorted(set(rows.kinds.tolist()) - {''})
    within = {kind: rows.where(rows.kinds == kind) for kind in kinds}
    quantiles = np.quantile(finite, [0.0, 0.05, 0.5, 0.95, 1.0]).tolist() if len(finite) else [math.nan] * 5
    names = ('least', 'quantile_05', 'median', 'quantile_95', 'greatest')
    return UncertaintyFigures(
        scans=len(rows.ranks),
        refused=len(rows.ranks) - len(finite),
        mean=float(finite.mean()) if len(finite) else math.nan,
        **dict(zip(names, quantiles, strict=True)),
        mean_by_kind={
            kind or ('clean' if known.any() else 'recorded'): _finite_mean(rows, kind) for kind in ['', *kinds]
        },
        spearman_severity={
            'all': spearman(rows.uncertainties[known], rows.severities[known]),
            **{kind: spearman(part.uncertainties, part.severities) for kind, part in within.items()},
        },
    )


def _finite_mean(rows: _Pooled, kind: str) -> float:
    values = rows.uncertainties[(rows.kinds == kind) & np.isfinite(rows.uncertainties)]
    return float(values.mean()) if len(values) else math.nan


def _figure(statistic: Statistic, rows: _Pooled, protocol: Protocol) -> Figure:
    whole = statistic(rows)
    low, high = bootstrap_interval(rows.pair, whole, resamples=protocol.resamples, seed=protocol.seed)
    of_pairs = np.array([statistic(rows.where(rows.pair == pair))(None) for pair in np.unique(rows.pair)])
    known = of_pairs[np.isfinite(of_pairs)]
    mean = float(known.mean()) if len(known) else math.nan
    return Figure(whole(None), low, high, mean)


def _recall_at(n: int) -> Statistic:
    return lambda rows: lambda weights: recall_at_n(rows.ranks, n, weights)


def _sparsification(rows: _Pooled) -> Weighted:
    area = _whole_area(rows)
    return lambda weights: 1.0 - area(weights)


def _auroc_wrong(rows: _Pooled) -> Weighted:
    counter = ScoreCounter(rows.uncertainties, ~rows.correct)
    return lambda weights: auroc_of(counter.counts(weights))


def _whole_area(rows: _Pooled) -> Weighted:
    counter = ScoreCounter(rows.uncertainties, rows.correct)
    return lambda weights: rejection_curve_of(counter.counts(weights)).mean_recall(1.0)


def _half_area(rows: _Pooled) -> Weighted:
    counter = ScoreCounter(rows.uncertainties, rows.correct)
    return lambda weights: rejection_curve_of(counter.counts(weights)).mean_recall(0.5)


def _average_precision(rows: _Pooled) -> Weighted:
    curve = _accepted_by_distance(rows)
    return lambda weights: curve(weights).average_precision


def _accepted_by_distance(
    rows: _Pooled, relevant: int | None = None
) -> Callable[[NDArray[np.float64] | None], PrecisionRecallCurve]:
    """Precision and recall of the nearest place of each query, accepted by its distance in embedding space.

    `relevant` is the number of queries with a positive; all of them by default.
    """
    counter = ScoreCounter(np.where(np.isfinite(rows.uncertainties), rows.distances, np.inf), rows.correct)

    def curve(weights: NDArray[np.float64] | None) -> PrecisionRecallCurve:
        counts = counter.counts(weights)
        return precision_recall_of(counts, float(counts.samples.sum()) if relevant is None else float(relevant))

    return curve


def max_f_beta(rows: _Pooled) -> dict[str, BestFBeta]:
    """The highest F_β over thresholds on the distance, by β."""
    curve = _accepted_by_distance(rows)(None)
    return {f'{beta:g}': BestFBeta(*curve.max_f_beta(beta)) for beta in BETAS}


def _by_other_maps(several: Sequence[Answers]) -> float:
    """AUROC of the share of the other maps of the world in which the same scan is answered wrongly; NaN without any.

    For comparison with that of U: it shows to what extent the scan, not the map, makes an answer wrong.
    """
    scores, wrong = [], []
    for answers in several:
        elsewhere = [
            other for other in several if other is not answers and _query_drive(other) == _query_drive(answers)
        ]
        times = np.sum([other.positive for other in elsewhere], axis=0) * answers.positive
        failed = np.sum([other.positive & ~other.correct for other in elsewhere], axis=0)
        known = times > 0
        scores.append((failed / np.maximum(times, 1))[known])
        wrong.append(~answers.correct[known])
    return auroc(np.concatenate(scores), np.concatenate(wrong))


def _query_drive(answers: Answers) -> tuple[str, str, int]:
    return answers.pair.group, answers.pair.world, answers.pair.query_index


def _by_severity(rows: _Pooled) -> tuple[SeverityBin, ...]:
    bins = []
    for low, high in itertools.pairwise(SEVERITIES):
        ranks = rows.ranks[(rows.severities > low) & (rows.severities <= high)]
        bins.append(SeverityBin(low, high, len(ranks), recall_at_n(ranks, 1)))
    return tuple(bins)
