"""What one scan says about every place: log likelihood ratios from the calibrated evidence for its answer.

A scan is summarised by the place that it finds and the evidence f for that answer. Let A be the places within the
tolerance of the one found, R the recall, and o the log-odds that the answer is right, among answers of which the share
π is right. Then

    at a place of A    p(f, A | here) = R p(f | right),      p(f | right) / p(f | not right) = exp(o) (1 − π) / π
    elsewhere          p(f, A | there) = (1 − R) p(f | not right) ρ(A)
    off the map        p(f, A | off) = p(f | not right) ρ(A)

where ρ(A) is the share of the road that A stands for: a wrong answer may be anywhere. So

    l = o − ln(π / (1 − π)) + ln R − ln ρ(A) for A as a whole,   l = ln(1 − R) elsewhere

Within A the likelihood is shared out by w_i = exp(o_i − o), o_i the log-odds with the distance of place i, and a small
part evenly: a place that resembles the scan much less than another one is seldom where the vehicle is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.retrieval.confidence import SimilarPlaces

EVEN_SHARE = 0.05
"""The part of the likelihood that all places within the tolerance of the one found share evenly."""


def log_likelihood_ratios(
    similar: SimilarPlaces, place_ids: NDArray[np.int64], shares: NDArray[np.float64], recall: float
) -> NDArray[np.float64]:
    """(N,) float64 l_i = log p(scan | at place i) − log p(scan | off the map), finite.

    Args:
        similar: the places near the one found; those that are not in `place_ids` are left out.
        place_ids: (N,) int64 of all places, ascending.
        shares: (N,) float64 ρ, the share of the mapped road that each place stands for.
        recall: R, the probability that the place found is right, of a scan on the map.
    """
    ratios = np.full(len(place_ids), np.log1p(-recall))
    rows = np.minimum(np.searchsorted(place_ids, similar.place_ids), max(len(place_ids) - 1, 0))
    known = place_ids[rows] == similar.place_ids if len(place_ids) else np.zeros(len(rows), np.bool_)
    rows, log_odds = rows[known], similar.log_odds[known]
    if not len(rows):
        return ratios
    best = float(log_odds.max())
    weights = np.exp(log_odds - best)
    road = shares[rows]
    within = (1.0 - EVEN_SHARE) * weights / (road @ weights) + EVEN_SHARE / road.sum()
    ratio = best - np.log(similar.base_rate / (1.0 - similar.base_rate))
    ratios[rows] = ratio + np.log(recall) + np.log(within)
    return ratios
