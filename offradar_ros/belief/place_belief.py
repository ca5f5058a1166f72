"""A discrete Bayes filter over the places of the map and one state more: off the map.

For the belief b over places i and off-map 0, the distance d driven since the last scan with evidence, and the log
likelihood ratios l_i = log p(scan | at place i) − log p(scan | off the map), with l_0 = 0:

    prediction   b⁻ = b T(d),  T(d) = [(1 − f) I + f T] Tⁿ for d = (n + f) strides of 10 m;
                 the mean of T over the possible d, and the mean d in α, where odometry does not give it
    update       b_i ∝ b⁻_i exp(α l_i),  α = min(1, d / independent_m)

One stride T from place i (see `PlaceGraph` for K, ρ and e; rates per metre become probabilities per stride, P):

    leaves the map    T_i0 = λ_i = P(leave_per_m + e_i leave_at_end_per_m)
    stays on it       T_ij = (1 − λ_i) [(1 − κ) K_ij + κ ρ_j],  κ = P(kidnapped_per_m)
    enters it         T_0j = ε ρ_j,  T_00 = 1 − ε,  ε = P(enter_per_m)

docs/localisation.md explains the choices.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.belief.place_graph import STRIDE_M, PlaceGraph
from offradar_ros.config import LocalisationConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.stamps import StampGate
from offradar_ros.types import Localisation, LocalisationState

MOST_STRIDES = 8
"""After a longer drive without evidence, where on the map the vehicle was is forgotten."""

LEAST_SHARE = 0.05
"""Without odometry, the least distance driven, as a share of the bound: a scan that resembles the same place as the one
before does not prove that the vehicle stands."""


class Belief(NamedTuple):
    """Probabilities that sum to 1: (N,) float64 of the places, and of off the map."""

    places: NDArray[np.float64]
    off_map: float


class PlaceBelief:
    """Where the vehicle is, from the evidence of all scans up to now. Not thread-safe.

    The vehicle is at a place if it is within `tolerance_m` of it; `p_here` is the probability of that.

    States (`p_off_map` is 1 − `p_on_map`):

    * ``on_map``: `p_here` has reached `decide_probability`, and has not fallen below `keep_probability` since.
    * ``off_map``: the same of `p_off_map`; never with an empty map.
    * ``lost``: neither, or no scan with evidence, for longer than `lost_after_s`: since the last scan with evidence
      that led to ``on_map`` or ``off_map``, or since the first scan. The position is still the best that is known.
    * ``unsure``: none of these, as after a cold start.
    """

    def __init__(self, config: LocalisationConfig, tolerance_m: float) -> None:
        self.config = config
        self._tolerance_m = tolerance_m
        self._gate = StampGate(round(config.restart_after_s * 1e9))
        self._place_ids = np.empty(0, np.int64)
        self._graph = PlaceGraph(np.empty((0, 2)), config.spacing_m, tolerance_m)
        self._enter, self._kidnapped = _in_stride(np.array([config.enter_per_m, config.kidnapped_per_m])).tolist()
        self._leave = np.empty(0)
        self.reset()

    def reset(self) -> None:
        """Forget all scans; the map stays."""
        self._gate.reset()
        self._restart_from(self._prior())
        self._last_ns: int | None = None
        # The best place of the last scan with evidence, and what was driven since: by odometry, and at most beyond it.
        self._seen_at_m: NDArray[np.float64] | None = None
        self._odometry_m, self._unknown_m = 0.0, 0.0
        self._decided: LocalisationState | None = None
        self._decided_ns = 0

    @property
    def place_ids(self) -> NDArray[np.int64]:
        """(N,) int64 of the places, in the order of `set_places`."""
        return self._place_ids

    @property
    def shares(self) -> NDArray[np.float64]:
        """(N,) float64 ρ, the share of the mapped road that each place stands for."""
        return self._graph.shares

    def without_memory(self) -> PlaceBelief:
        """A belief over the same map that has seen no scan."""
        made = PlaceBelief(self.config, self._tolerance_m)
        made._place_ids, made._graph, made._leave = self._place_ids, self._graph, self._leave
        made.reset()
        return made

    @property
    def belief(self) -> Belief:
        """The belief after the last scan with evidence, changed by `set_places` since."""
        return self._belief

    def set_places(self, positions_m: NDArray[np.float64], place_ids: NDArray[np.int64]) -> None:
        """Take another map, or the same with places added, moved or removed.

        Places that stay, by id and within reach of where they were, keep their probability. That of a removed place
        goes to the places in reach, because the vehicle is still there, and to off the map if there are none. Added
        places get theirs from the next scans on. If no place stays, or the map was empty, the belief starts again.

        Args:
            positions_m: (N, 2) or (N, 3) float64 in the ``map`` frame; heights are not used.
            place_ids: (N,) int64, each once.

        Raises:
            RefusedInput: (`invalid_places`) for other shapes, positions that are not finite or ids that repeat, and as
                `PlaceGraph`; the map is then unchanged.
        """
        positions_m, place_ids = np.asarray(positions_m, np.float64), np.asarray(place_ids, np.int64)
        if positions_m.ndim != 2 or positions_m.shape[1] not in {2, 3} or place_ids.shape != positions_m.shape[:1]:
            raise RefusedInput(
                'invalid_places',
                f'places of shape {positions_m.shape} with ids of shape {place_ids.shape} refused: expected (N, 2) or '
                '(N, 3), and (N,)',
            )
        positions_m = positions_m[:, :2].copy()
        if not np.isfinite(positions_m).all():
            raise RefusedInput('invalid_places', 'places refused: a position is not finite')
        if len(np.unique(place_ids)) != len(place_ids):
            raise RefusedInput('invalid_places', 'places refused: a place id occurs twice')
        old_ids, old = self._place_ids, self._graph
        if np.array_equal(old_ids, place_ids) and np.array_equal(old.positions_m, positions_m):
            return
        config = self.config
        self._graph = PlaceGraph(positions_m, config.spacing_m, self._tolerance_m)
        self._place_ids = place_ids.copy()
        self._leave = _in_stride(config.leave_per_m + config.leave_at_end_per_m * self._graph.ends)
        _, before, now = np.intersect1d(old_ids, place_ids, assume_unique=True, return_indices=True)
        near = np.linalg.norm(old.positions_m[before] - positions_m[now], axis=1) <= STRIDE_M + config.spacing_m
        before, now = before[near], now[near]
        if not len(before):
            self._restart_from(self._prior())
            self._seen_at_m = None
            self._odometry_m, self._unknown_m = 0.0, 0.0
            return
        places = np.zeros(len(place_ids))
        places[now] = self._belief.places[before]
        left = np.setdiff1d(np.arange(len(old_ids)), before)
        places += self._graph.moved_in(old.positions_m[left], self._belief.places[left])
        self._restart_from(_normalised(places, max(1.0 - float(places.sum()), 0.0)))

    def step(
        self,
        stamp_ns: int,
        log_likelihood_ratios: NDArray[np.float64] | None,
        travelled_m: float | None = None,
    ) -> Localisation:
        """Use one scan, and say where the vehicle is.

        Args:
            stamp_ns: the scan's stamp. A jump back of more than `restart_after_s`, or forward of more than
                `forget_after_s`, starts again from the prior.
            log_likelihood_ratios: (N,) finite l_i of each place, in the order of `set_places`; None for a scan without
                evidence, which gives a prediction only.
            travelled_m: distance driven since the last call; None if it is not known.

        Raises:
            RefusedInput: `repeated_stamp`, `stamp_backwards` (as `StampGate`), `invalid_evidence` or
                `invalid_distance`. The scan then changes nothing.
        """
        ratios = None if log_likelihood_ratios is None else self._checked(log_likelihood_ratios)
        if travelled_m is not None and not 0.0 <= travelled_m < math.inf:
            raise RefusedInput('invalid_distance', f'distance driven {travelled_m} m refused: expected 0 or more')
        late = self._last_ns is not None and stamp_ns - self._last_ns > self.config.forget_after_s * 1e9
        if self._gate.check(stamp_ns) or late:
            self.reset()
            self._gate.check(stamp_ns)
        if self._last_ns is None:
            self._decided_ns = stamp_ns
        elif travelled_m is None:
            self._unknown_m += self.config.max_speed_mps * (stamp_ns - self._last_ns) * 1e-9
        else:
            self._odometry_m += travelled_m
        self._last_ns = stamp_ns

        if ratios is None or not len(ratios):
            belief = self._predicted(self._unknown_m)
        else:
            belief = self._updated(ratios)
            self._restart_from(belief)
        return self._localisation(stamp_ns, belief, has_evidence=ratios is not None and len(ratios) > 0)

    def _restart_from(self, belief: Belief) -> None:
        self._belief = belief
        # b Tⁿ for n = 0, 1, …, kept because scans without evidence go on from there.
        self._strides = [belief]

    def _prior(self) -> Belief:
        on_map = self.config.prior_on_map if len(self._graph) else 0.0
        return Belief(on_map * self._graph.shares, 1.0 - on_map)

    def _checked(self, log_likelihood_ratios: NDArray[np.float64]) -> NDArray[np.float64]:
        ratios = np.asarray(log_likelihood_ratios, np.float64)
        if ratios.shape != self._place_ids.shape or not np.isfinite(ratios).all():
            raise RefusedInput(
                'invalid_evidence',
                f'log likelihood ratios of shape {ratios.shape} refused: expected {len(self._place_ids)} finite ones',
            )
        return ratios

    def _updated(self, ratios: NDArray[np.float64]) -> Belief:
        """The belief after a scan with evidence; what was driven since the last one is then used up."""
        seen_at_m = self._graph.positions_m[int(np.argmax(ratios))]
        unknown_m = self._unknown_m
        if self._seen_at_m is not None:
            # Without odometry, the scans themselves show how far the vehicle went between them.
            apart_m = float(np.linalg.norm(seen_at_m - self._seen_at_m))
            unknown_m = min(max(apart_m, LEAST_SHARE * unknown_m), unknown_m)
        predicted = self._predicted(unknown_m)
        driven_m = math.inf if self._seen_at_m is None else self._odometry_m + unknown_m / 2.0
        weight = min(1.0, driven_m / self.config.independent_m)
        self._seen_at_m, self._odometry_m, self._unknown_m = seen_at_m, 0.0, 0.0
        with np.errstate(divide='ignore'):
            logs = np.log(predicted.places) + weight * ratios
            log_off = float(np.log(predicted.off_map))
        largest = max(float(logs.max()), log_off)
        return _normalised(np.exp(logs - largest), math.exp(log_off - largest))

    def _predicted(self, unknown_m: float) -> Belief:
        """b T(d), the mean over any d from the distance by odometry to `unknown_m` more."""
        least, most = self._odometry_m / STRIDE_M, (self._odometry_m + unknown_m) / STRIDE_M
        weights = _weights_of_strides(least, most)
        last = int(np.flatnonzero(weights)[-1]) if weights.any() else 0
        while len(self._strides) <= last:
            self._strides.append(self._after_stride(self._strides[-1]))
        # The rest is beyond the most strides.
        rest = max(1.0 - float(weights.sum()), 0.0)
        beyond = self._forgotten((max(least, MOST_STRIDES) + max(most, MOST_STRIDES)) / 2.0)
        places = rest * beyond.places
        for weight, belief in zip(weights.tolist(), self._strides, strict=False):
            if weight > 0.0:
                places += weight * belief.places
        off_maps = [belief.off_map for belief in self._strides[: last + 1]]
        return Belief(places, float(weights[: last + 1] @ off_maps) + rest * beyond.off_map)

    def _after_stride(self, belief: Belief) -> Belief:
        """b T."""
        staying = (1.0 - self._leave) * belief.places
        on_map = float(staying.sum())
        anywhere = self._kidnapped * on_map + self._enter * belief.off_map
        places = (1.0 - self._kidnapped) * self._graph.driven(staying) + anywhere * self._graph.shares
        # What left the map: at most 0 by rounding where all is off it.
        left = max(float(belief.places.sum()) - on_map, 0.0)
        return Belief(places, (1.0 - self._enter) * belief.off_map + left) if len(self._graph) else belief

    def _forgotten(self, strides: float) -> Belief:
        """b Tⁿ as if every place were left at the mean rate λ: p_on → ε / (λ + ε), by the factor (1 − λ − ε)ⁿ."""
        leave = float(self._graph.shares @ self._leave)
        balance = self._enter / (leave + self._enter) if len(self._graph) else 0.0
        remains = max(1.0 - leave - self._enter, 0.0) ** strides
        on_map = balance + (1.0 - self._belief.off_map - balance) * remains
        return Belief(on_map * self._graph.shares, 1.0 - on_map)

    def _localisation(self, stamp_ns: int, belief: Belief, has_evidence: bool) -> Localisation:
        p_on_map = min(float(belief.places.sum()), 1.0)
        if not len(self._graph):
            state = self._state(stamp_ns, None, has_evidence)
            return Localisation(stamp_ns, state, 0.0, None, 0.0, np.full(2, np.nan), np.full((2, 2), np.nan))
        best = self._graph.best(belief.places)
        around = self._graph.around(best)
        mass, positions_m = belief.places[around], self._graph.positions_m[around]
        p_here = min(float(mass.sum()), p_on_map)
        # Equal weights where every place here has underflowed to 0.
        weights = mass / p_here if p_here > 0.0 else np.full(len(mass), 1.0 / len(mass))
        position_m = weights @ positions_m
        offsets_m = positions_m - position_m
        # A place stands for a stretch of road as long as the spacing: a uniform distribution has its square / 12.
        cell = self.config.spacing_m**2 / 12.0 * np.eye(2)
        covariance_m2 = (weights[:, None] * offsets_m).T @ offsets_m + cell
        state = self._state(stamp_ns, self._decision(p_here, belief.off_map), has_evidence)
        return Localisation(stamp_ns, state, p_on_map, int(self._place_ids[best]), p_here, position_m, covariance_m2)

    def _decision(self, p_here: float, p_off_map: float) -> LocalisationState | None:
        for state, probability in ((LocalisationState.ON_MAP, p_here), (LocalisationState.OFF_MAP, p_off_map)):
            keeps = self._decided is state
            if probability >= (self.config.keep_probability if keeps else self.config.decide_probability):
                return state
        return None

    def _state(self, stamp_ns: int, decision: LocalisationState | None, has_evidence: bool) -> LocalisationState:
        self._decided = decision
        if decision is not None and has_evidence:
            self._decided_ns = stamp_ns
        if stamp_ns - self._decided_ns > self.config.lost_after_s * 1e9:
            return LocalisationState.LOST
        return decision or LocalisationState.UNSURE


def _in_stride(rates_per_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The probabilities of an event in a stride: 1 − exp(−rate · stride)."""
    probabilities: NDArray[np.float64] = -np.expm1(-STRIDE_M * rates_per_m)
    return probabilities


def _weights_of_strides(least: float, most: float) -> NDArray[np.float64]:
    """(MOST_STRIDES + 1,) weights of 0, 1, … whole strides in the mean of T(d) over d from `least` to `most` strides.

    T(d) is interpolated linearly between whole strides: the weight of k is the mean of max(0, 1 − |d − k|).
    """
    whole = np.arange(MOST_STRIDES + 1, dtype=np.float64)
    if most - least < 1e-9:
        return np.asarray(np.maximum(0.0, 1.0 - np.abs(most - whole)))
    return (_hat_integral(most - whole) - _hat_integral(least - whole)) / (most - least)


def _hat_integral(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """∫ max(0, 1 − |t|) dt from −∞ to each of the (M,) ends."""
    t = np.clip(ends, -1.0, 1.0)
    return np.where(t < 0.0, (1.0 + t) ** 2 / 2.0, 1.0 - (1.0 - t) ** 2 / 2.0)


def _normalised(places: NDArray[np.float64], off_map: float) -> Belief:
    total = float(places.sum()) + off_map
    return Belief(places / total, off_map / total)
