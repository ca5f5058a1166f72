"""Figures of the paper's ablation: O, M, M_random, Q and QM."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.maintenance import Ablation
from offradar_ros.lab.evaluation.metrics.bootstrap import bootstrap_interval
from offradar_ros.lab.evaluation.metrics.recall_at_n import recall_at_n
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.results.ablation import CASES, AblationFigures
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.summary import recognition


def summarise_ablation(several: Sequence[Ablation], threshold: float, protocol: Protocol) -> AblationFigures:
    """Figures over the queries with a positive in the unmaintained map; all cases have the same queries."""
    keep = [a.unmaintained.positive for a in several]
    accepted = [a.unmaintained.uncertainties <= threshold for a in several]
    answered = [k & u for k, u in zip(keep, accepted, strict=True)]
    before, after = [a.unmaintained for a in several], [a.maintained for a in several]
    draws = zip(*(a.random for a in several), strict=True)
    recalls = (
        _recall(before, keep),
        _recall(after, keep),
        float(np.mean([_recall(draw, keep) for draw in draws])),
        _recall(before, answered),
        _recall(after, answered),
    )
    return AblationFigures(
        recall_at_1=dict(zip(CASES, recalls, strict=True)),
        threshold=threshold,
        rejected=math.nan if math.isnan(threshold) else _share_rejected(answered, keep),
        ordered_pairs=len(several),
        queries=int(np.concatenate(keep).sum()),
        opportunities=sum(a.opportunities for a in several),
        replaced=sum(a.replaced for a in several),
        unmaintained=recognition(before, protocol),
        maintained=recognition(after, protocol),
        gain_over_unmaintained=_gain(several, lambda a: [a.unmaintained], protocol),
        gain_over_random=_gain(several, lambda a: list(a.random), protocol),
    )


def _gain(several: Sequence[Ablation], other: Callable[[Ablation], Sequence[Answers]], protocol: Protocol) -> Interval:
    """Recall@1 of the maintained map minus that of others on the same queries, with a bootstrap interval over pairs."""
    differences, pairs = [], []
    for number, ablation in enumerate(several):
        keep = ablation.unmaintained.positive
        theirs = np.mean([answers.correct for answers in other(ablation)], axis=0)
        differences.append((ablation.maintained.correct - theirs)[keep])
        pairs.append(np.full(int(keep.sum()), number))
    every = np.concatenate(differences)
    if not len(every):
        return Interval(math.nan, math.nan, math.nan)
    low, high = bootstrap_interval(
        np.concatenate(pairs), lambda w: float(w @ every / w.sum()), resamples=protocol.resamples, seed=protocol.seed
    )
    return Interval(float(every.mean()), low, high)


def _share_rejected(answered: Sequence[NDArray[np.bool_]], keep: Sequence[NDArray[np.bool_]]) -> float:
    return 1.0 - float(np.concatenate(answered).sum()) / max(1, int(np.concatenate(keep).sum()))


def _recall(several: Sequence[Answers], chosen: Sequence[NDArray[np.bool_]]) -> float:
    return recall_at_n(np.concatenate([a.ranks[c] for a, c in zip(several, chosen, strict=True)]), 1)
