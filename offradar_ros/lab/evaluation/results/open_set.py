"""How well right answers are told from wrong ones and from queries that are off the map."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class AtPrecision:
    """What is answered at the lowest threshold on a confidence at which answers have the wanted precision.

    Attributes:
        precision: the one that is wanted.
        right_kept: share of the right answers that is still given: recall over Recall@1; NaN if no answer is right.
        off_map_answered: share of the queries off the map that is answered; NaN if none is off the map.
    """

    precision: Measure
    right_kept: Measure
    off_map_answered: Measure


@dataclasses.dataclass(frozen=True)
class ConfidenceFigures:
    """One confidence as a detector of answers that are wrong or off the map.

    Attributes:
        auroc: probability that a right answer has a higher confidence than a wrong one; equal values count half.
        average_precision: of the detection, with wrong answers as positives.
        at_precision: at each of the precisions that are reported, ascending.
        aurc: area under the risk–coverage curve.
        augrc: area under the generalised risk–coverage curve.
        precisions: (101,) highest precision at which a share 0, 0.01, …, 1 of the queries on the map is answered
            rightly, 0 above the highest share; empty if no query is on the map.
    """

    auroc: Interval
    average_precision: Measure
    at_precision: tuple[AtPrecision, ...]
    aurc: Measure
    augrc: Measure
    precisions: tuple[Measure, ...]


@dataclasses.dataclass(frozen=True)
class GateFigures:
    """What the gate in use answers.

    Attributes:
        rule: ``p_right``, ``U``, or ``none`` if every query is answered.
        limit: the least probability, or the highest U; NaN for none.
        answers: number of queries that are answered.
        answered_on_map: share of the queries on the map; NaN if there is none, as for the next two.
        answered_on_map_clean: the same of clean scans; NaN where it is unknown which are clean.
        answered_off_map: share of the queries off the map.
        wrong: share of the answers that is wrong; NaN without answers.
        right_rejected: share of the right answers that is rejected.
    """

    rule: str
    limit: Measure
    answers: int
    answered_on_map: Measure
    answered_on_map_clean: Measure
    answered_off_map: Measure
    wrong: Measure
    right_rejected: Measure


@dataclasses.dataclass(frozen=True)
class OpenSetFigures:
    """Figures of all queries: an answer to one whose map holds no place within the tolerance is wrong.

    Attributes:
        on_map: number of queries whose map holds a place within the tolerance.
        off_map: number of the others.
        confidences: by name, those of `confidences.CONFIDENCES` that are known.
        ece: expected calibration error of the probability; NaN where it is unknown.
        brier: Brier score of the probability; NaN where it is unknown.
        gate: the gate in use.
    """

    on_map: int
    off_map: int
    confidences: dict[str, ConfidenceFigures]
    ece: Measure
    brier: Measure
    gate: GateFigures
