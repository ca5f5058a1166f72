"""The belief against a sum over all paths of the vehicle; maps that change, and scans without evidence."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from offradar_ros.belief.place_belief import LEAST_SHARE, MOST_STRIDES, PlaceBelief
from offradar_ros.belief.place_graph import STRIDE_M, PlaceGraph
from offradar_ros.config import LocalisationConfig
from offradar_ros.errors import ConfigError, RefusedInput
from offradar_ros.types import Localisation, LocalisationState

CONFIG = LocalisationConfig(independent_m=5.0)
TOLERANCE_M = 25.0
PERIOD_NS = 250_000_000
ON, OFF, UNSURE, LOST = (
    LocalisationState.ON_MAP,
    LocalisationState.OFF_MAP,
    LocalisationState.UNSURE,
    LocalisationState.LOST,
)


def road(count: int, y_m: float = 0.0) -> NDArray[np.float64]:
    """Places every 10 m."""
    return np.stack([np.arange(count) * 10.0, np.full(count, y_m)], axis=1)


def belief_over(
    positions_m: NDArray[np.float64], config: LocalisationConfig = CONFIG, tolerance_m: float = TOLERANCE_M
) -> PlaceBelief:
    made = PlaceBelief(config, tolerance_m)
    made.set_places(positions_m, np.arange(len(positions_m)))
    return made


def at(positions_m: NDArray[np.float64], x_m: float, y_m: float = 0.0) -> NDArray[np.float64]:
    """Evidence for the places within 10 m of the vehicle."""
    return np.where(np.linalg.norm(positions_m - [x_m, y_m], axis=1) <= 10.0, 6.0, -6.0)


def drive(
    belief: PlaceBelief,
    positions_m: NDArray[np.float64],
    xs_m: NDArray[np.float64],
    first: int = 1,
    step_m: float | None = 2.5,
) -> list[Localisation]:
    """The answers along the road, one scan each 2.5 m."""
    return [belief.step((first + i) * PERIOD_NS, at(positions_m, x_m), step_m) for i, x_m in enumerate(xs_m.tolist())]


# The posterior is the sum over all paths.


def stride_matrix(positions_m: NDArray[np.float64], config: LocalisationConfig) -> NDArray[np.float64]:
    """T of the docstring of the module, entry by entry; the last state is off the map."""
    n = len(positions_m)
    graph = PlaceGraph(positions_m, config.spacing_m, TOLERANCE_M)
    matrix = np.zeros((n + 1, n + 1))
    kidnapped = 1.0 - math.exp(-STRIDE_M * config.kidnapped_per_m)
    enter = 1.0 - math.exp(-STRIDE_M * config.enter_per_m)
    for i in range(n):
        rate = config.leave_per_m + graph.ends[i] * config.leave_at_end_per_m
        leave = 1.0 - math.exp(-STRIDE_M * rate)
        near = [j for j in range(n) if np.hypot(*(positions_m[i] - positions_m[j])) <= STRIDE_M + config.spacing_m]
        for j in range(n):
            along = graph.shares[j] / graph.shares[near].sum() if j in near else 0.0
            matrix[i, j] = (1 - leave) * ((1 - kidnapped) * along + kidnapped * graph.shares[j])
        matrix[i, n] = leave
        matrix[n, i] = enter * graph.shares[i]
    matrix[n, n] = 1.0 - enter
    return matrix


def transition(matrix: NDArray[np.float64], least_m: float, most_m: float) -> NDArray[np.float64]:
    """The mean of T(d), d uniform from `least_m` to `most_m`; exact, because T(d) is linear between whole strides."""
    least, most = least_m / STRIDE_M, most_m / STRIDE_M

    def of(strides: float) -> NDArray[np.float64]:
        whole = math.floor(strides)
        some: NDArray[np.float64] = np.linalg.matrix_power(matrix, whole)
        fraction = strides - whole
        between: NDArray[np.float64] = some @ ((1 - fraction) * np.eye(len(matrix)) + fraction * matrix)
        return between

    if most - least < 1e-9:
        return of(least)
    knots = [least, *(k for k in range(MOST_STRIDES) if least < k < most), most]
    total = sum((b - a) * (of(a) + of(b)) / 2.0 for a, b in itertools.pairwise(knots))
    return np.asarray(total / (most - least))


@dataclasses.dataclass(frozen=True)
class Scan:
    ratios: list[float] | None
    travelled_m: float | None


def scans_of(places: int) -> st.SearchStrategy[list[Scan]]:
    ratio = st.floats(-8.0, 8.0)
    return st.lists(
        st.builds(
            Scan,
            st.none() | st.lists(ratio, min_size=places, max_size=places),
            st.none() | st.floats(0.0, 12.0),
        ),
        min_size=1,
        max_size=5,
    )


def by_paths(positions_m: NDArray[np.float64], scans: list[Scan], config: LocalisationConfig) -> NDArray[np.float64]:
    """(N + 1,) the posterior after the last scan: every path of states is enumerated."""
    n, matrix = len(positions_m), stride_matrix(positions_m, config)
    prior = np.full(n + 1, 1.0 - config.prior_on_map)
    prior[:n] = config.prior_on_map * PlaceGraph(positions_m, config.spacing_m, TOLERANCE_M).shares
    steps, seen_m = [], None
    odometry_m = unknown_m = 0.0
    for index, scan in enumerate(scans):
        if index and scan.travelled_m is None:
            unknown_m += config.max_speed_mps * PERIOD_NS * 1e-9
        elif index:
            odometry_m += scan.travelled_m or 0.0
        if scan.ratios is None:
            continue
        best_m = positions_m[int(np.argmax(scan.ratios))]
        weight = 1.0
        if seen_m is not None:
            apart_m = max(float(np.hypot(*(best_m - seen_m))), LEAST_SHARE * unknown_m)
            unknown_m = min(apart_m, unknown_m)
            weight = min(1.0, (odometry_m + unknown_m / 2.0) / config.independent_m)
        likelihoods = np.exp(weight * np.array([*scan.ratios, 0.0]))
        steps.append((transition(matrix, odometry_m, odometry_m + unknown_m), likelihoods))
        seen_m, odometry_m, unknown_m = best_m, 0.0, 0.0
    if scans[-1].ratios is None:
        steps.append((transition(matrix, odometry_m, odometry_m + unknown_m), np.ones(n + 1)))
    posterior = np.zeros(n + 1)
    for path in itertools.product(range(n + 1), repeat=len(steps) + 1):
        probability = prior[path[0]]
        for (moves, likelihoods), before, now in zip(steps, path, path[1:], strict=False):
            probability *= moves[before, now] * likelihoods[now]
        posterior[path[-1]] += probability
    posterior /= posterior.sum()
    return posterior


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_the_belief_is_the_sum_over_all_paths(data: st.DataObject) -> None:
    n = data.draw(st.integers(1, 3))
    coordinate = st.floats(0.0, 60.0)
    positions_m = np.array(data.draw(st.lists(st.tuples(coordinate, coordinate), min_size=n, max_size=n)))
    scans = data.draw(scans_of(n))
    config = dataclasses.replace(CONFIG, kidnapped_per_m=0.01)
    belief = belief_over(positions_m, config, tolerance_m=20.0)
    for index, scan in enumerate(scans, start=1):
        ratios = None if scan.ratios is None else np.array(scan.ratios)
        found = belief.step(index * PERIOD_NS, ratios, scan.travelled_m)
    expected = by_paths(positions_m, scans, config)
    best = positions_m[belief.place_ids.tolist().index(found.place_id)]
    near = np.hypot(*(positions_m - best).T) <= 20.0
    assert found.p_on_map == pytest.approx(1.0 - expected[-1], abs=1e-9)
    assert found.p_here == pytest.approx(expected[:-1][near].sum(), abs=1e-9)
    if scans[-1].ratios is not None:
        assert belief.belief.places == pytest.approx(expected[:-1], abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_probabilities_sum_to_one_with_any_evidence_and_motion(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    belief = belief_over(rng.uniform(0.0, 200.0, (count, 2)))
    stamp_ns = 1
    for _ in range(20):
        stamp_ns += int(rng.choice([1, 10**8, 10**9, 10**11]))
        ratios = None if rng.random() < 0.3 else rng.normal(0.0, rng.choice([1.0, 100.0, 1e4]), count)
        found = belief.step(stamp_ns, ratios, None if rng.random() < 0.5 else float(rng.exponential(30.0)))
        places, off_map = belief.belief
        assert places.sum() + off_map == pytest.approx(1.0)
        assert min(places.min(), off_map) >= 0.0
        assert 0.0 <= found.p_here <= found.p_on_map <= 1.0
        assert np.isfinite(found.position_m).all()
        assert np.linalg.eigvalsh(found.covariance_m2).min() > 0.0


def test_the_order_and_the_ids_of_places_do_not_matter() -> None:
    rng = np.random.default_rng(5)
    positions_m = rng.uniform(0.0, 400.0, (80, 2))
    order, ids = rng.permutation(80), rng.permutation(1000)[:80]
    one, other = belief_over(positions_m), PlaceBelief(CONFIG, TOLERANCE_M)
    other.set_places(positions_m[order], ids[order])
    for index in range(1, 12):
        ratios = rng.normal(-2.0, 3.0, 80)
        ratios[7] += 8.0
        evidence = index % 3 > 0
        a = one.step(index * PERIOD_NS, ratios if evidence else None, 2.0 if index > 6 else None)
        b = other.step(index * PERIOD_NS, ratios[order] if evidence else None, 2.0 if index > 6 else None)
        assert a.place_id is not None
        assert b.place_id == ids[a.place_id]
        assert (b.p_on_map, b.p_here) == pytest.approx((a.p_on_map, a.p_here))
        assert b.position_m == pytest.approx(a.position_m)
        assert b.covariance_m2 == pytest.approx(a.covariance_m2)
        assert b.state is a.state


def test_a_far_place_hardly_matters() -> None:
    positions_m = road(40)
    more = np.concatenate([positions_m, [[5000.0, 5000.0]]])
    xs_m = np.arange(100.0, 130.0, 2.5)
    for a, b in zip(
        drive(belief_over(positions_m), positions_m, xs_m), drive(belief_over(more), more, xs_m), strict=True
    ):
        assert b.p_here == pytest.approx(a.p_here, abs=0.01)
        assert b.place_id == a.place_id


def test_a_road_that_is_mapped_twice_as_densely_is_no_more_likely() -> None:
    positions_m, once = road(40), road(40)
    twice = np.concatenate([once, once])
    for a, b in zip(
        drive(belief_over(once), positions_m, np.arange(100.0, 130.0, 2.5)),
        drive(belief_over(twice), twice, np.arange(100.0, 130.0, 2.5)),
        strict=True,
    ):
        assert (b.p_on_map, b.p_here) == pytest.approx((a.p_on_map, a.p_here))


# Motion.


@pytest.mark.parametrize('step_m', [2.5, None])
def test_a_drive_along_the_road_is_followed(step_m: float | None) -> None:
    positions_m = road(60)
    xs_m = np.arange(100.0, 300.0, 2.5)
    for x_m, found in list(zip(xs_m, drive(belief_over(positions_m), positions_m, xs_m, step_m=step_m), strict=True))[
        5:
    ]:
        assert found.state is ON
        assert abs(found.position_m[0] - x_m) <= 10.0


@pytest.mark.parametrize('step_m', [2.5, None])
def test_a_vehicle_that_is_carried_elsewhere_is_found_again(step_m: float | None) -> None:
    positions_m = road(300)
    belief = belief_over(positions_m)
    drive(belief, positions_m, np.arange(100.0, 200.0, 2.5), step_m=step_m)
    after = drive(belief, positions_m, np.arange(2000.0, 2050.0, 2.5), first=1000, step_m=step_m)
    assert all(found.state is ON and abs(found.position_m[0] - 2000.0) < 70.0 for found in after[10:])


def test_a_vehicle_that_stands_is_no_more_certain_after_many_scans() -> None:
    positions_m = road(40)
    belief = belief_over(positions_m)
    first = belief.step(1, at(positions_m, 100.0), 0.0)
    for index in range(1, 500):
        last = belief.step(1 + index * PERIOD_NS, at(positions_m, 100.0), 0.0)
    assert 0.1 < first.p_here < 0.99
    assert last.p_here == pytest.approx(first.p_here)


def test_without_odometry_scans_of_one_place_count_little() -> None:
    positions_m, weak = road(40), 0.5
    standing, moving = belief_over(positions_m), belief_over(positions_m)
    for index in range(1, 17):
        still = standing.step(index * PERIOD_NS, weak * at(positions_m, 100.0))
        driven = moving.step(index * PERIOD_NS, weak * at(positions_m, 100.0 + 6.0 * index))
    assert still.p_here < 0.9
    assert driven.p_here > 0.98


def test_without_evidence_the_belief_spreads_with_the_distance_driven() -> None:
    positions_m = road(200)
    belief = belief_over(positions_m)
    drive(belief, positions_m, np.arange(1000.0, 1050.0, 2.5))
    found = [belief.step(10**10 + i * PERIOD_NS, None, 5.0) for i in range(40)]
    p_here = [f.p_here for f in found]
    assert p_here == sorted(p_here, reverse=True)
    assert p_here[0] > 0.95
    assert p_here[-1] < 0.1
    assert found[-1].covariance_m2[0, 0] > found[0].covariance_m2[0, 0]
    # The next scan is found where the vehicle went meanwhile.
    assert drive(belief, positions_m, np.arange(1250.0, 1265.0, 2.5), first=1000)[-1].state is ON


def test_a_vehicle_that_stands_without_evidence_keeps_its_belief() -> None:
    positions_m = road(60)
    belief = belief_over(positions_m)
    before = drive(belief, positions_m, np.arange(100.0, 150.0, 2.5))[-1]
    after = belief.step(10**10, None, 0.0)
    assert (after.p_on_map, after.p_here) == pytest.approx((before.p_on_map, before.p_here))


def test_a_long_gap_without_odometry_forgets_the_place() -> None:
    positions_m = road(200)
    belief = belief_over(positions_m)
    drive(belief, positions_m, np.arange(1000.0, 1050.0, 2.5))
    found = belief.step(10**12, None)
    assert found.p_here < 0.1
    assert 0.0 < found.p_on_map < 1.0


def test_the_map_is_left_sooner_where_it_ends() -> None:
    def p_on_map(x_m: float) -> float:
        positions_m = road(60)
        belief = belief_over(positions_m)
        drive(belief, positions_m, np.arange(x_m - 25.0, x_m + 0.1, 2.5))
        return belief.step(10**10, None, 10.0).p_on_map

    assert p_on_map(590.0) < 0.9
    assert p_on_map(300.0) > 0.99


def test_leaving_the_map_and_coming_back_is_noticed() -> None:
    positions_m = road(60)
    belief = belief_over(positions_m)
    assert drive(belief, positions_m, np.arange(500.0, 590.0, 2.5))[-1].state is ON
    beyond = drive(belief, positions_m, np.arange(602.5, 700.0, 2.5), first=100)
    assert all(found.state is OFF for found in beyond[20:])
    back = drive(belief, positions_m, np.arange(590.0, 490.0, -2.5), first=200)
    assert all(found.state is ON for found in back[10:])


# Maps that change.


def localised(positions_m: NDArray[np.float64]) -> PlaceBelief:
    """A belief that is certain of 100 m along the road."""
    belief = belief_over(positions_m)
    drive(belief, positions_m, np.arange(50.0, 101.0, 2.5))
    return belief


def test_places_that_stay_keep_their_probability() -> None:
    positions_m = road(40)
    belief = localised(positions_m)
    before = belief.step(10**10, None, 0.0)
    order = np.random.default_rng(2).permutation(45)
    more = np.concatenate([road(40, 2.0), road(5, 900.0)])
    belief.set_places(more[order], order)
    after = belief.step(2 * 10**10, None, 0.0)
    assert after.place_id == before.place_id
    assert (after.p_on_map, after.p_here) == pytest.approx((before.p_on_map, before.p_here))
    assert after.position_m - before.position_m == pytest.approx([0.0, 2.0])


def test_the_probability_of_a_removed_place_goes_to_those_in_reach() -> None:
    positions_m = road(40)
    belief = localised(positions_m)
    before = belief.belief
    keep = np.arange(40) != 10
    belief.set_places(positions_m[keep], np.flatnonzero(keep))
    assert belief.belief.off_map == pytest.approx(before.off_map)
    assert belief.step(10**10, None, 0.0).state is ON


def test_the_probability_of_a_removed_road_goes_to_off_the_map() -> None:
    positions_m = np.concatenate([road(40), road(40, 1000.0)])
    belief = localised(positions_m)
    belief.set_places(positions_m[40:], np.arange(40, 80))
    assert belief.belief.off_map > 0.99
    assert belief.step(10**10, None, 0.0).state is OFF


def test_an_id_that_is_now_far_away_is_another_place() -> None:
    positions_m = road(40)
    belief = localised(positions_m)
    swapped = positions_m.copy()
    swapped[[10, 35]] = swapped[[35, 10]]
    belief.set_places(swapped, np.arange(40))
    found = belief.step(10**10, None, 0.0)
    assert found.position_m[0] == pytest.approx(100.0, abs=15.0)
    assert found.place_id != 10


def test_another_map_starts_from_the_prior() -> None:
    belief = localised(road(40))
    belief.set_places(road(40), np.arange(100, 140))
    assert belief.belief.off_map == pytest.approx(0.5)


def test_a_map_with_no_places_has_an_answer() -> None:
    belief = PlaceBelief(CONFIG, TOLERANCE_M)
    first = belief.step(1, None)
    assert (first.state, first.place_id, first.p_on_map, first.p_here) == (UNSURE, None, 0.0, 0.0)
    assert np.isnan(first.position_m).all()
    assert belief.step(2 * 10**10, np.empty(0)).state is LOST
    belief.set_places(road(3), np.arange(3))
    assert belief.belief.off_map == pytest.approx(0.5)
    belief.set_places(np.empty((0, 3)), np.empty(0, np.int64))
    assert belief.step(3 * 10**10, None, 500.0).p_on_map == 0.0


def test_heights_do_not_matter() -> None:
    flat, high = belief_over(road(20)), PlaceBelief(CONFIG, TOLERANCE_M)
    high.set_places(np.column_stack([road(20), np.linspace(0.0, 900.0, 20)]), np.arange(20))
    xs_m = np.arange(50.0, 100.0, 2.5)
    assert drive(flat, road(20), xs_m)[-1].p_here == drive(high, road(20), xs_m)[-1].p_here


# States.


def push(belief: PlaceBelief, stamp_ns: int, p_here: float) -> Localisation:
    """A scan with such evidence that the only place of the map has probability `p_here` after it."""
    before = belief.step(stamp_ns, None, 10.0).p_on_map
    ratio = math.log(p_here / (1.0 - p_here)) - math.log(before / (1.0 - before))
    found = belief.step(stamp_ns + 1, np.array([ratio]), 0.0)
    assert found.p_here == pytest.approx(p_here)
    return found


def test_states_have_hysteresis() -> None:
    belief = belief_over(road(1), dataclasses.replace(CONFIG, decide_probability=0.95, keep_probability=0.7))
    expected = [
        (0.94, UNSURE), (0.96, ON), (0.75, ON), (0.65, UNSURE), (0.75, UNSURE), (0.96, ON), (0.04, OFF), (0.25, OFF),
        (0.35, UNSURE), (0.25, UNSURE),
    ]  # fmt: skip
    found = [push(belief, i * PERIOD_NS, p).state for i, (p, _) in enumerate(expected, start=1)]
    assert found == [state for _, state in expected]


def test_no_decision_for_long_is_lost() -> None:
    belief = belief_over(road(1))
    second = 10**9
    assert push(belief, second, 0.5).state is UNSURE
    assert push(belief, 10 * second, 0.5).state is UNSURE
    assert push(belief, 12 * second, 0.5).state is LOST
    assert push(belief, 13 * second, 0.995).state is ON


def test_no_evidence_for_long_is_lost_although_the_vehicle_stands() -> None:
    belief = belief_over(road(1))
    second = 10**9
    push(belief, second, 0.995)
    assert belief.step(10 * second, None, 0.0).state is ON
    lost = belief.step(12 * second, None, 0.0)
    assert lost.state is LOST
    assert lost.p_here == pytest.approx(0.995)
    assert belief.step(13 * second, np.array([0.0]), 0.0).state is ON


# Stamps and input.


def test_a_recording_that_starts_again_starts_from_the_prior() -> None:
    positions_m = road(40)
    belief, other = localised(positions_m), belief_over(positions_m)
    again = belief.step(1, at(positions_m, 300.0))
    first = other.step(1, at(positions_m, 300.0))
    assert (again.p_here, again.state) == (first.p_here, first.state)


def test_refused_input_changes_nothing() -> None:
    positions_m = road(40)
    belief = localised(positions_m)
    last_ns, before = 21 * PERIOD_NS, belief.belief.places.copy()
    evidence = at(positions_m, 300.0)
    refused = [
        ('repeated_stamp', last_ns, evidence, None),
        ('stamp_backwards', last_ns - 10**8, evidence, None),
        ('invalid_evidence', last_ns + 1, evidence[1:], None),
        ('invalid_evidence', last_ns + 1, np.full(40, np.nan), None),
        ('invalid_distance', last_ns + 1, evidence, -1.0),
        ('invalid_distance', last_ns + 1, evidence, math.nan),
    ]
    for cause, stamp_ns, ratios, travelled_m in refused:
        with pytest.raises(RefusedInput) as error:
            belief.step(stamp_ns, ratios, travelled_m)
        assert error.value.cause == cause
    for positions, ids in ((np.zeros(3), np.arange(3)), (road(2), np.zeros(2)), (np.full((1, 2), np.inf), np.zeros(1))):
        with pytest.raises(RefusedInput) as error:
            belief.set_places(positions, ids.astype(np.int64))
        assert error.value.cause == 'invalid_places'
    assert belief.belief.places.tolist() == before.tolist()
    assert belief.step(last_ns + 1, None, 0.0).state is ON


def test_the_probability_that_keeps_a_state_is_not_above_the_one_that_starts_it() -> None:
    with pytest.raises(ConfigError, match='keep_probability: expected at most'):
        LocalisationConfig(decide_probability=0.8, keep_probability=0.9)
