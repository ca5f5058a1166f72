"""How well two scans agree is judged patch by patch: one thing that both have is not a place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plane import Plane, make_plane

from offradar_ros.alignment.align import align, prepare_place, prepare_query
from offradar_ros.alignment.refine import agreement, correlations, edges, surface
from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.top_down import TopDown, top_down
from offradar_ros.types import PolarScan

MAKE = SignatureMaker()
PIXELS = 3000


def view(scan: PolarScan) -> TopDown:
    return top_down(MAKE(scan))


def score_in_loops(place: TopDown, query: TopDown) -> float:
    """At the pose of the place itself: the mean over 12 sectors × 4 rings of the query's 3000 steepest pixels."""
    side = query.side
    slope = np.zeros((side, side))
    for row in range(1, side - 1):
        for column in range(1, side - 1):
            if query.seen[row - 1 : row + 2, column - 1 : column + 2].min() > 0.0:
                part = query.image[row - 1 : row + 2, column - 1 : column + 2].astype(float)
                across = (part[:, 2] - part[:, 0]) @ [1.0, 2.0, 1.0]
                down = (part[2] - part[0]) @ [1.0, 2.0, 1.0]
                slope[row, column] = across**2 + down**2
    patches: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for flat in np.argsort(-slope.ravel(), kind='stable')[:PIXELS].tolist():
        row, column = divmod(flat, side)
        x_m, y_m = column + 0.5 - side / 2.0, row + 0.5 - side / 2.0
        ring = sum(math.hypot(x_m, y_m) >= end_m for end_m in (14.0, 26.0, 44.0))
        sector = int((math.atan2(y_m, x_m) / (2.0 * math.pi) + 0.5) * 12) % 12
        if slope[row, column] > 0.0 and place.seen[row, column] > 0.0:
            pair = float(query.image[row, column]), float(place.image[row, column])
            patches.setdefault((sector, ring), []).append(pair)
    found = [np.corrcoef(np.array(pairs).T)[0, 1] for pairs in patches.values() if len(pairs) >= 20]
    return float(np.sum(found) / (len(found) + 2.0))


def test_it_is_the_mean_correlation_of_patches() -> None:
    place, query = view(make_plane(1).scan()), view(make_plane(1).scan(seed=1))
    (found,) = agreement([surface(place)], edges(query, PIXELS), np.zeros((1, 3)))
    assert found == pytest.approx(score_in_loops(place, query), abs=0.01)
    assert found > 0.5


def test_a_lorry_beside_the_vehicle_in_both_scans_does_not_make_two_places_one() -> None:
    sides = np.linspace(-8.0, 8.0, 80)
    lorry = Plane(np.column_stack([sides, np.full(80, 6.0)]), np.full(80, 200.0))

    def beside(seed: int) -> PolarScan:
        street = make_plane(seed)
        points_m = np.concatenate([street.points_m, lorry.points_m])
        return Plane(points_m, np.concatenate([street.powers, lorry.powers])).scan(seed=seed)

    places, query = [surface(view(beside(seed))) for seed in (1, 2)], edges(view(beside(1)), PIXELS)
    here, elsewhere = agreement(places, query, np.zeros((2, 3)))
    whole_here, whole_elsewhere = correlations(places, query, np.zeros((2, 3)))
    assert here > 0.5
    assert elsewhere < 0.5 * whole_elsewhere
    assert here / elsewhere > 1.5 * whole_here / whole_elsewhere


def test_a_small_overlap_convinces_less() -> None:
    scan = make_plane(1).scan()
    sector = np.zeros(len(scan.power), np.bool_)
    sector[:34] = True
    power = np.where(sector[:, None], scan.power, 0).astype(np.uint8)
    part = PolarScan(scan.stamp_ns, power, scan.azimuths_rad, scan.range_resolution_m, scan.range_offset_m)
    whole, little = (align(prepare_place(MAKE(scan)), prepare_query(MAKE(one))) for one in (scan, part))
    assert whole.score > 0.8
    assert little.score < 0.75 * whole.score


def test_without_anything_to_compare_nothing_agrees() -> None:
    place = view(make_plane(1).scan())
    empty = TopDown(np.zeros_like(place.image), place.seen, place.cell_m)
    assert agreement([surface(place)], edges(empty, PIXELS), np.zeros((1, 3))).tolist() == [0.0]
