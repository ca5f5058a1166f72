"""Recall, F_β and average precision of searches: the columns of the paper's Tab. 1 and 2."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.results.figure import Figure
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class BestFBeta:
    """The highest F_β over thresholds on the distance in embedding space, and the threshold that gives it."""

    value: Measure
    distance: Measure


@dataclasses.dataclass(frozen=True)
class EveryQuery:
    """Figures of all queries; one whose map holds no place within the tolerance is always wrong.

    They are NaN if there is no other query: nothing could be found.
    """

    recall_at_1: Measure
    recall_at_5: Measure
    recall_at_10: Measure
    average_precision: Measure


@dataclasses.dataclass(frozen=True)
class Recognition:
    """Figures of the queries whose map holds a place within the tolerance.

    Attributes:
        recall_at_1: share of the queries whose nearest place is a positive.
        recall_at_5: share with a positive among the five nearest.
        recall_at_10: share with a positive among the ten nearest.
        average_precision: over thresholds on the distance of the nearest place, with one answer per query.
        max_f_beta: highest F_β by β, as text: ``0.5``, ``1``, ``2``.
        every_query: figures of all queries.
    """

    recall_at_1: Figure
    recall_at_5: Figure
    recall_at_10: Figure
    average_precision: Figure
    max_f_beta: dict[str, BestFBeta]
    every_query: EveryQuery
