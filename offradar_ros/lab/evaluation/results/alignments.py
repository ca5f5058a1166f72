"""What aligning scans with the places found gives: the order of answers, the probability, and poses."""

from __future__ import annotations

import dataclasses
import math

from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class RecallAtPrecision:
    """What is answered rightly at the lowest threshold on `p_right` at which answers have the wanted precision.

    Attributes:
        precision: the one that is wanted.
        by_distance: share of the queries on the map, without alignments.
        aligned: the same with them.
    """

    precision: Measure
    by_distance: Measure
    aligned: Measure


@dataclasses.dataclass(frozen=True)
class AnswerFigures:
    """Answers by distance alone and with alignments; shares are of the queries on the map, NaN if there is none.

    Attributes:
        queries: number of queries.
        on_map: number of them whose map holds a place within the tolerance.
        places: k, number of nearest places that are aligned.
        recall_at_1_by_distance: the nearest place in embedding space is right.
        recall_at_1_aligned: the likeliest of the k places is right.
        recall_at_k: any of them is right.
        recall_at_10: any of the ten nearest places is right; they need not be aligned.
        at_precision: recall at each of the precisions that are reported, ascending.
        auroc_score: probability that the score of a right answer is higher than that of a wrong one, as below; answers
            to queries off the map are wrong.
        auroc_p_by_distance: of `p_right` without alignments.
        auroc_p_aligned: of `p_right` with them.
    """

    queries: int
    on_map: int
    places: int
    recall_at_1_by_distance: Measure
    recall_at_1_aligned: Measure
    recall_at_k: Measure
    recall_at_10: Measure
    at_precision: tuple[RecallAtPrecision, ...]
    auroc_score: Measure
    auroc_p_by_distance: Measure
    auroc_p_aligned: Measure

    @property
    def closed(self) -> float:
        """Share of the errors that alignments correct, of those whose right place is among the ten nearest.

        (Recall@1 aligned − Recall@1 by distance) / (Recall@10 − Recall@1 by distance); NaN if there is none.
        """
        left_open = self.recall_at_10 - self.recall_at_1_by_distance
        return (self.recall_at_1_aligned - self.recall_at_1_by_distance) / left_open if left_open > 0.0 else math.nan


@dataclasses.dataclass(frozen=True)
class PoseFigures:
    """Errors of poses. One within 2 m and 2° is right; others are wrong altogether, whatever their covariance.

    Attributes:
        pairs: number of queries and places that were aligned with each other, at least 1.
        right: share that is within 2 m and 2°.
        median_m: of the position.
        quantile_90_m: of the position.
        median_deg: of the heading.
        quantile_90_deg: of the heading.
        within_half: share that is within .5 m and .5°.
        nees: normalised estimation error squared eᵀ Σ⁻¹ e of the right ones, their mean over its three dimensions:
            1 if errors are as large as their covariance says, above 1 if they are larger; NaN if none is right.
        in_ellipsoid: share of the right ones whose error is in its 95 % ellipsoid; NaN if none is right.
    """

    pairs: int
    right: Measure
    median_m: Measure
    quantile_90_m: Measure
    median_deg: Measure
    quantile_90_deg: Measure
    within_half: Measure
    nees: Measure
    in_ellipsoid: Measure


@dataclasses.dataclass(frozen=True)
class AlignmentFigures:
    """Figures of one method and one kind of map. Parts without a pair are left out.

    Attributes:
        answers: None where the method has no coefficients for the score of an alignment.
        by_distance: poses of clean scans by their distance from the place on the ground, driven in its direction or
            ``the other way``.
        by_way: poses of clean scans within 10 m of the place: in its direction and lane, in its direction beside its
            lane, or the other way.
        by_fault: poses of scans within 10 m of the place, by the kind of their degradation.
    """

    answers: AnswerFigures | None
    by_distance: dict[str, PoseFigures]
    by_way: dict[str, PoseFigures]
    by_fault: dict[str, PoseFigures]
