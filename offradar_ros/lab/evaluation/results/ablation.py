"""The paper's ablation of the system: maintained maps and introspective querying."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.results.recognition import Recognition
from offradar_ros.records import Measure

CASES = ('O', 'M', 'M_random', 'Q', 'QM')
"""The map of one drive, the maintained map, random replacement; the first two with introspective querying."""


@dataclasses.dataclass(frozen=True)
class AblationFigures:
    """O, M, M_random, Q and QM of one method, over the queries with a positive in the unmaintained map.

    Attributes:
        recall_at_1: of each of `CASES`. O, M and M_random answer every query; Q and QM those whose U is at most the
            threshold, NaN without one. M_random is the mean over its draws.
        threshold: the one in use, NaN for none.
        rejected: share of the queries that Q and QM reject.
        ordered_pairs: number of ordered pairs of drives.
        queries: number of queries over all pairs.
        opportunities: number of merged scans with a place within D_t.
        replaced: number of those that replaced the place.
        unmaintained: further figures of O.
        maintained: further figures of M.
        gain_over_unmaintained: Recall@1 of M minus that of O.
        gain_over_random: Recall@1 of M minus that of M_random.
    """

    recall_at_1: dict[str, Measure]
    threshold: Measure
    rejected: Measure
    ordered_pairs: int
    queries: int
    opportunities: int
    replaced: int
    unmaintained: Recognition
    maintained: Recognition
    gain_over_unmaintained: Interval
    gain_over_random: Interval
