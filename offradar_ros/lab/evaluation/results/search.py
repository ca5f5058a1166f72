"""Figures of one method in maps of one spacing."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.results.figure import Figure, Interval
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
    """What one static threshold leaves of the queries that have a positive.

    Attributes:
        threshold: on U.
        rejected: share of them that is rejected.
        kept: how many are answered.
        recall_at_1: of those that are answered; NaN where none is.
    """

    threshold: Measure
    rejected: Measure
    kept: int
    recall_at_1: Measure


@dataclasses.dataclass(frozen=True)
class AtDeployedThreshold(AtThreshold):
    """What the one threshold in use does to all queries.

    An answer to a query without a positive is wrong, and a rejected query that has one is missed.

    Attributes:
        rejected_of_every_query: share of all queries that is rejected.
        precision: share of the answers that is right; NaN without any.
        f_beta: by β, as text.
    """

    rejected_of_every_query: Measure
    precision: Measure
    f_beta: dict[str, Measure]


@dataclasses.dataclass(frozen=True)
class PairLevelFigures:
    """Of every query with every place, mean over pairs of drives.

    Attributes:
        average_precision: NaN where no pair of drives has a positive pair.
        precisions: at recall 0, 0.01, …, 1; empty likewise.
    """

    average_precision: Interval
    precisions: tuple[Measure, ...]


@dataclasses.dataclass(frozen=True)
class SearchFigures(Recognition):
    """Figures of one method and one map spacing over the pairs of a group.

    Queries without a positive are left out of all but `queries`, `every_query` and `at_deployed_threshold`.

    Attributes:
        pairs: ordered pairs of drives.
        queries: scans that were searched for.
        with_positive: those of them that have a positive.
        places: of a map, on average.
        recall_at_1_clean: of clean scans.
        recall_at_1_degraded: of degraded scans.
        recall_at_1_by_kind: by what is wrong with the scan.
        recall_at_1_by_severity: of degraded scans, by how badly.
        auroc_wrong: of U as a detector of wrong answers.
        auroc_wrong_by_severity: of the true severity, as a yardstick.
        auroc_wrong_by_other_maps: of how often the same scan is answered wrongly in the other maps of its world.
        spearman_correct: rank correlation of U with being right.
        recall_at_rejection: (rejected share, Recall@1 of the rest), the most uncertain rejected first.
        recall_at_threshold: for each static threshold, ascending.
        at_deployed_threshold: None where no threshold is in use.
        auc_recall_at_rejection: mean of Recall@RR over rejected shares 0 to 1.
        auc_recall_at_rejection_to_half: 0 to 0.5.
        pair_level: of every query with every place.
        ausc: area under the sparsification curve.
        ause: area under the sparsification error.
        ece: expected calibration error.
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
