"""Recall, F_β and average precision of searches: what a row of the paper's Tab. 1 and 2 says."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.results.figure import Figure
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class BestFBeta:
    """The highest F_β over thresholds on the distance in embedding space, and the distance that gives it."""

    value: Measure
    distance: Measure


@dataclasses.dataclass(frozen=True)
class EveryQuery:
    """Figures of all queries, also of those whose map holds no place within the tolerance: these are never right."""

    recall_at_1: Measure
    recall_at_5: Measure
    recall_at_10: Measure
    average_precision: Measure


@dataclasses.dataclass(frozen=True)
class Recognition:
    """Figures of the queries whose map holds a place within the tolerance.

    Attributes:
        recall_at_1: share of the queries with a positive at the nearest place.
        recall_at_5: among the five nearest.
        recall_at_10: among the ten nearest.
        average_precision: over thresholds on the distance of the nearest place, one answer a query.
        max_f_beta: by β, as text: ``0.5``, ``1``, ``2``.
        every_query: the same of all queries.
    """

    recall_at_1: Figure
    recall_at_5: Figure
    recall_at_10: Figure
    average_precision: Figure
    max_f_beta: dict[str, BestFBeta]
    every_query: EveryQuery
