"""Everything about a radar and how surfaces return that is not geometry.

Three sources: `NOMINAL_PHYSICS` is near what recorded Navtech scans show; `draw_physics` varies it broadly, to train
with; `held_out_physics` draws from a family that `draw_physics` never reaches, to judge what was trained: each field in
`HELD_OUT_RANGES` lies outside its range in `TRAINED_RANGES`, and speckle follows another law.

Powers are linear or decibels (10 log10) above the receiver's noise at its reference; the recorded byte is in half
decibels.
"""

from __future__ import annotations

import dataclasses
import enum
import math

import numpy as np


class SpeckleLaw(str, enum.Enum):
    """How the power of a rough surface is distributed about its mean."""

    RAYLEIGH = 'rayleigh'
    LOG_NORMAL = 'log_normal'
    K = 'k'


@dataclasses.dataclass(frozen=True)
class RadarPhysics:
    """Attributes, in the order of a signal's way.

    returns_db: strength of all returns from walls and scatterers.
    fall_exponent: returns fall with this power of range.
    incidence_exponent: a wall's diffuse return falls with this power of the cosine of incidence.
    diffuse_floor_db: a wall's return at grazing incidence, relative to its own face on.
    specular_db: flash of a wall within `specular_width_rad` of face on, relative to its diffuse return.
    specular_width_rad: standard deviation of that flash in angle.
    lump_exponent: unevenness along walls; 0 makes them even, 1 exponential.
    lump_m: length over which a wall is alike.
    echo_db: what a wall gives back late, from rooms, corners and second walls behind it, in all.
    echo_m: mean distance of that behind it.
    occlusion: a wall leaves its `wall_through` to this power; less than 1 where the beam also passes over it.
    ghost_db: what a copy mirrored in a wall, or a second lap between wall and vehicle, has of its original.
    ground_db: ground clutter at 10 m.
    ground_exponent: it falls with this power of range.
    ground_start_m: nearer than this the beam passes over the ground.
    ground_patch_db: standard deviation of its patches, which stay where they are in the world.
    vehicle_db: what the radar's own vehicle returns from nearer than 2.4 m.
    beam_width_rad: half-power width of the beam, one way.
    side_lobe_db: level of the side lobes, there and back.
    side_lobe_width_rad: their standard deviation in angle.
    range_sigma_m: standard deviation of a return's spread along range.
    skirt_db: level of the wider skirt that the transmitter's phase noise gives every return.
    skirt_m: standard deviation of that skirt.
    streak_db: what the strongest return of an azimuth adds to the noise of all its range.
    speckle: law of speckle.
    speckle_looks: independent looks in a cell; more are smoother.
    speckle_correlation_m: standard deviation of the filter that makes neighbouring cells alike.
    noise_db: the receiver's noise.
    noise_near_m: range at which noise is twice its far level.
    noise_near_exponent: how steeply it falls to that.
    noise_correlation_m: as `speckle_correlation_m`.
    noise_shape: power to which exponential noise is raised; 1 leaves it exponential.
    gain_db: added to everything that is recorded.
    knee: byte above which the receiver saturates softly.
    ceiling: byte that it approaches.
    whole_powers: whether linear power is cut to a whole number before its logarithm is taken, as recorded bytes of
        0, 6, 9, 12, 14 half decibels (1, 2, 3, 4, 5) show.
    """

    returns_db: float = 8.0
    fall_exponent: float = 1.4
    incidence_exponent: float = 6.0
    diffuse_floor_db: float = -16.0
    specular_db: float = 10.0
    specular_width_rad: float = 0.04
    lump_exponent: float = 1.8
    lump_m: float = 0.8
    echo_db: float = -14.0
    echo_m: float = 10.0
    occlusion: float = 0.8
    ghost_db: float = -16.0
    ground_db: float = 3.0
    ground_exponent: float = 0.9
    ground_start_m: float = 12.0
    ground_patch_db: float = 7.0
    vehicle_db: float = 17.0
    beam_width_rad: float = 0.0314
    side_lobe_db: float = -36.0
    side_lobe_width_rad: float = 0.08
    range_sigma_m: float = 0.15
    skirt_db: float = -32.0
    skirt_m: float = 1.0
    streak_db: float = -57.0
    speckle: SpeckleLaw = SpeckleLaw.RAYLEIGH
    speckle_looks: float = 1.5
    speckle_correlation_m: float = 0.165
    noise_db: float = 0.0
    noise_near_m: float = 3.0
    noise_near_exponent: float = 1.0
    noise_correlation_m: float = 0.165
    noise_shape: float = 1.0
    gain_db: float = 1.2
    knee: float = 120.0
    ceiling: float = 170.0
    whole_powers: bool = True


NOMINAL_PHYSICS = RadarPhysics()

TRAINED_RANGES: dict[str, tuple[float, float]] = {
    'returns_db': (2.0, 12.0),
    'fall_exponent': (1.0, 1.9),
    'incidence_exponent': (2.0, 10.0),
    'diffuse_floor_db': (-22.0, -10.0),
    'specular_db': (0.0, 15.0),
    'specular_width_rad': (0.02, 0.08),
    'lump_exponent': (0.7, 2.4),
    'lump_m': (0.5, 1.5),
    'echo_db': (-30.0, -10.0),
    'echo_m': (4.0, 16.0),
    'occlusion': (0.5, 1.3),
    'ghost_db': (-35.0, -12.0),
    'ground_db': (-4.0, 9.0),
    'ground_exponent': (0.4, 2.0),
    'ground_start_m': (3.0, 20.0),
    'ground_patch_db': (2.0, 9.0),
    'vehicle_db': (5.0, 30.0),
    'beam_width_rad': (0.024, 0.045),
    'side_lobe_db': (-45.0, -26.0),
    'side_lobe_width_rad': (0.05, 0.15),
    'range_sigma_m': (0.1, 0.22),
    'skirt_db': (-45.0, -25.0),
    'skirt_m': (0.6, 2.0),
    'streak_db': (-75.0, -52.0),
    'speckle_looks': (1.0, 3.0),
    'speckle_correlation_m': (0.1, 0.25),
    'noise_db': (-4.0, 6.0),
    'noise_near_m': (0.0, 120.0),
    'noise_near_exponent': (0.7, 1.5),
    'noise_correlation_m': (0.1, 0.25),
    'noise_shape': (0.85, 1.15),
    'gain_db': (-1.0, 12.0),
    'knee': (105.0, 140.0),
}
"""Least and greatest value of each number that `draw_physics` varies."""

HELD_OUT_RANGES: dict[str, tuple[float, float]] = {
    'ghost_db': (-9.0, -5.0),
    'beam_width_rad': (0.055, 0.075),
    'streak_db': (-49.0, -44.0),
    'noise_shape': (1.35, 1.7),
    'knee': (65.0, 85.0),
}
"""Where `held_out_physics` leaves the ranges of training: stronger multipath, a wider beam, and so on."""


def draw_physics(seed: int | np.random.Generator) -> RadarPhysics:
    """A radar for one world of training; speckle is always `RAYLEIGH`."""
    return _draw(np.random.default_rng(seed), TRAINED_RANGES, SpeckleLaw.RAYLEIGH)


def held_out_physics(seed: int | np.random.Generator = 0) -> RadarPhysics:
    """A radar of a kind that training never sees: to judge by, also which checkpoint is best, never to learn from."""
    rng = np.random.default_rng(seed)
    law = (SpeckleLaw.LOG_NORMAL, SpeckleLaw.K)[int(rng.integers(2))]
    return _draw(rng, TRAINED_RANGES | HELD_OUT_RANGES, law)


def _draw(rng: np.random.Generator, ranges: dict[str, tuple[float, float]], law: SpeckleLaw) -> RadarPhysics:
    drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
    ceiling = drawn['knee'] + float(rng.uniform(25.0, 60.0))
    return RadarPhysics(**drawn, speckle=law, ceiling=ceiling, whole_powers=bool(rng.random() < 0.5))


def ratio(decibels: float) -> float:
    """Decibels to linear power."""
    return math.pow(10.0, decibels / 10.0)
