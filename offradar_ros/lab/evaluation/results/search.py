"""Figures of one method in maps of one spacing."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.results.figure import Figure, Interval
from offradar_ros.lab.evaluation.results.open_set import OpenSetFigures
from offradar_ros.lab.evaluation.results.recognition import Recognition
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class SeverityBin:
    """Recall@1 of the `queries` whose severity is greater than `above` and at most `up_to`."""

    above: Measure
    up_to: Measure
    queries: int
    recall_at_1: Measure


@dataclasses.dataclass(frozen=True)
class AtThreshold:
    """Figures at one static threshold, of the queries that have a positive.

    Attributes:
        threshold: on U.
        rejected: share of these queries that is rejected.
        kept: number of these queries that is answered.
        recall_at_1: of the answered ones; NaN if none is.
    """

    threshold: Measure
    rejected: Measure
    kept: int
    recall_at_1: Measure


@dataclasses.dataclass(frozen=True)
class AtDeployedThreshold(AtThreshold):
    """Figures at the threshold in use, also of all queries.

    An answer to a query without a positive is wrong, and a rejected query that has one is missed.

    Attributes:
        rejected_of_every_query: share of all queries that is rejected.
        precision: share of the answers to all queries that are correct; NaN without answers.
        f_beta: F_β of all queries, by β as text.
    """

    rejected_of_every_query: Measure
    precision: Measure
    f_beta: dict[str, Measure]


@dataclasses.dataclass(frozen=True)
class PairLevelFigures:
    """Figures of every query with every place, mean over pairs of drives.

    Attributes:
        average_precision: NaN if no pair of drives has a positive pair.
        precisions: (101,) at recall 0, 0.01, …, 1; empty if no pair of drives has a positive pair.
    """

    average_precision: Interval
    precisions: tuple[Measure, ...]


@dataclasses.dataclass(frozen=True)
class SearchFigures(Recognition):
    """Figures of one method and one map spacing over the pairs of a group.

    Queries without a positive are left out of all but `queries`, `every_query`, `at_deployed_threshold` and `open_set`.

    Attributes:
        pairs: number of ordered pairs of drives.
        queries: number of scans that were searched for.
        with_positive: number of queries with a positive.
        places: mean number of places of a map.
        recall_at_1_clean: of clean scans.
        recall_at_1_degraded: of degraded scans.
        recall_at_1_by_kind: by the kind of degradation.
        recall_at_1_by_severity: of degraded scans, by severity.
        auroc_wrong: of U as a detector of wrong answers.
        auroc_wrong_by_severity: the same of the true severity, for comparison.
        auroc_wrong_by_other_maps: the same of the share of the other maps of the world in which the scan is answered
            wrongly, for comparison.
        spearman_correct: rank correlation of U with correctness.
        recall_at_rejection: (rejected share, Recall@1 of the rest) at the shares of the protocol.
        recall_at_threshold: for each static threshold, ascending.
        at_deployed_threshold: None without a threshold in use.
        auc_recall_at_rejection: mean of Recall@RR over rejected shares 0 to 1.
        auc_recall_at_rejection_to_half: mean of Recall@RR over rejected shares 0 to 0.5.
        pair_level: figures of every query with every place.
        ausc: area under the sparsification curve.
        ause: area under the sparsification error.
        ece: expected calibration error of U.
        open_set: right answers against wrong ones and queries off the map.
    """

    pairs: int
    queries: int
    with_positive: int
    places: Measure
    recall_at_1_clean: Figure
    recall_at_1_degraded: Figure
    recall_at_1_by_kind: dict[str, Measure]
    recall_at_1_by_severity: tuple[SeverityBin, ...]
    auroc_wrong: Figure
    auroc_wrong_by_severity: Measure
    auroc_wrong_by_other_maps: Measure
    spearman_correct: Measure
    recall_at_rejection: tuple[tuple[Measure, Measure], ...]
    recall_at_threshold: tuple[AtThreshold, ...]
    at_deployed_threshold: AtDeployedThreshold | None
    auc_recall_at_rejection: Figure
    auc_recall_at_rejection_to_half: Figure
    pair_level: PairLevelFigures
    ausc: Figure
    ause: Measure
    ece: Measure
    open_set: OpenSetFigures
