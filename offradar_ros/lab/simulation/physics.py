"""Parameters of the radar and of surfaces, without geometry.

There are four sources. `NOMINAL_PHYSICS` is close to recorded Navtech scans. `draw_physics` varies it broadly, for
training. `held_out_physics` draws radars that `draw_physics` never draws, for validation, which chooses, and for the
coefficients of `p_right`: each field in `HELD_OUT_RANGES` lies outside its range in `TRAINED_RANGES`, and speckle
follows another law. `unseen_physics` draws radars that neither of them draws, in the same way, for results alone.

Powers are linear, or decibels (10 log10) above the receiver's noise at its reference; the recorded byte is in half
decibels.
"""

from __future__ import annotations

import dataclasses
import enum
import math

import numpy as np


class SpeckleLaw(str, enum.Enum):
    """Distribution of the power of a rough surface about its mean."""

    RAYLEIGH = 'rayleigh'
    LOG_NORMAL = 'log_normal'
    K = 'k'
    WEIBULL = 'weibull'


@dataclasses.dataclass(frozen=True)
class RadarPhysics:
    """One radar and how surfaces return its signal.

    Attributes:
        returns_db: power of all returns from walls and scatterers.
        range_exponent: exponent of range by which returns fall.
        incidence_exponent: exponent of the cosine of incidence by which a wall's diffuse return falls.
        diffuse_floor_db: diffuse return of a wall at grazing incidence, relative to normal incidence.
        specular_db: specular return of a wall at normal incidence, relative to its diffuse return.
        specular_width_rad: standard deviation of the specular return in angle.
        texture_exponent: variation of power along walls; 0 for none, 1 for an exponential distribution.
        texture_m: length over which the power of a wall is constant.
        echo_db: total power of late returns of a wall, from rooms, corners and further walls behind it.
        echo_m: mean distance of late returns behind the wall.
        occlusion: exponent of `wall_transmission`; below 1 where the beam also passes over walls.
        tail_db: level of the tail that a return leaves behind it, relative to the return.
        tail_m: distance over which that tail falls to 1/e.
        ghost_walls: number of walls, those with the strongest returns, that mirror everything in front of them.
        ghost_db: power of a multipath copy (mirrored in a wall, or of a further round trip between wall and vehicle),
            relative to the original.
        ground_db: ground clutter at 10 m.
        ground_exponent: exponent of range by which ground clutter falls.
        ground_start_m: at shorter range the beam passes over the ground.
        ground_patch_db: standard deviation of patches of ground clutter, which are fixed in the world.
        slope_db: return of a slope that rises into the beam, relative to flat ground.
        slope_share: share of the ground that is such a slope.
        vehicle_db: return of the radar's own vehicle, at less than 2.4 m.
        beam_width_rad: half-power width of the one-way beam.
        side_lobe_db: two-way level of the side lobes.
        side_lobe_width_rad: standard deviation of the side lobes in angle.
        range_sigma_m: standard deviation of the range response.
        skirt_db: level of the wide skirt that the transmitter's phase noise gives every return.
        skirt_m: standard deviation of that skirt.
        streak_db: noise over all ranges of an azimuth, relative to its strongest return.
        speckle: law of speckle.
        speckle_looks: independent looks per cell; more looks, smoother speckle.
        speckle_correlation_m: standard deviation of the filter that correlates neighbouring cells.
        noise_db: noise of the receiver.
        noise_near_m: range at which noise is twice that at long range.
        noise_near_exponent: exponent of range by which the noise at short range falls.
        haze_db: noise near the radar, at all azimuths alike, above that at long range.
        haze_m: range over which the haze falls to 1/e.
        noise_correlation_m: as `speckle_correlation_m`.
        noise_shape: exponent of exponentially distributed noise; 1 leaves it exponential.
        gain_db: gain of everything that is recorded.
        gain_drift_db: standard deviation of the gain over a drive, as the receiver warms up and cools down.
        noise_drift_db: standard deviation of the noise over a drive.
        sector_gain_db: standard deviation of the gain over azimuth, the same in all scans: the radome, and what stands
            beside it on the roof.
        knee: byte above which the receiver saturates softly.
        ceiling: byte that saturation approaches.
        integer_powers: whether linear power is truncated to an integer before its logarithm is taken, as recorded
            bytes of 0, 6, 9, 12, 14 half decibels (1, 2, 3, 4, 5) show.
    """

    returns_db: float = 6.33
    range_exponent: float = 1.0
    incidence_exponent: float = 4.47
    diffuse_floor_db: float = -14.8
    specular_db: float = 9.45
    specular_width_rad: float = 0.04
    texture_exponent: float = 1.55
    texture_m: float = 1.0
    echo_db: float = -13.9
    echo_m: float = 18.6
    occlusion: float = 0.615
    tail_db: float = -40.8
    tail_m: float = 7.71
    ghost_walls: int = 2
    ghost_db: float = -20.0
    ground_db: float = 4.2
    ground_exponent: float = 0.773
    ground_start_m: float = 23.0
    ground_patch_db: float = 7.0
    slope_db: float = 12.7
    slope_share: float = 0.0906
    vehicle_db: float = 17.0
    beam_width_rad: float = 0.031
    side_lobe_db: float = -31.5
    side_lobe_width_rad: float = 0.08
    range_sigma_m: float = 0.19
    skirt_db: float = -41.7
    skirt_m: float = 1.89
    streak_db: float = -53.7
    speckle: SpeckleLaw = SpeckleLaw.RAYLEIGH
    speckle_looks: float = 1.0
    speckle_correlation_m: float = 0.234
    noise_db: float = -2.67
    noise_near_m: float = 11.0
    noise_near_exponent: float = 1.07
    haze_db: float = -4.37
    haze_m: float = 35.8
    noise_correlation_m: float = 0.131
    noise_shape: float = 1.09
    gain_db: float = 0.9
    gain_drift_db: float = 0.5
    noise_drift_db: float = 0.5
    sector_gain_db: float = 1.0
    knee: float = 120.0
    ceiling: float = 170.0
    integer_powers: bool = True


NOMINAL_PHYSICS = RadarPhysics()

TRAINED_RANGES: dict[str, tuple[float, float]] = {
    'returns_db': (0.0, 14.0),
    'range_exponent': (0.9, 2.2),
    'incidence_exponent': (2.0, 10.0),
    'diffuse_floor_db': (-24.0, -10.0),
    'specular_db': (0.0, 15.0),
    'specular_width_rad': (0.02, 0.08),
    'texture_exponent': (0.7, 2.6),
    'texture_m': (0.5, 1.5),
    'echo_db': (-30.0, -8.0),
    'echo_m': (4.0, 22.0),
    'occlusion': (0.5, 1.8),
    'tail_db': (-60.0, -28.0),
    'tail_m': (4.0, 35.0),
    'ghost_db': (-35.0, -10.5),
    'ground_db': (-8.0, 12.0),
    'ground_exponent': (0.4, 2.6),
    'ground_start_m': (3.0, 30.0),
    'ground_patch_db': (2.0, 10.0),
    'slope_db': (4.0, 18.0),
    'slope_share': (0.0, 0.2),
    'vehicle_db': (5.0, 30.0),
    'beam_width_rad': (0.02, 0.05),
    'side_lobe_db': (-45.0, -24.0),
    'side_lobe_width_rad': (0.05, 0.15),
    'range_sigma_m': (0.1, 0.22),
    'skirt_db': (-45.0, -24.0),
    'skirt_m': (0.6, 2.2),
    'streak_db': (-75.0, -50.5),
    'speckle_looks': (1.0, 3.0),
    'speckle_correlation_m': (0.1, 0.28),
    'noise_db': (-5.0, 6.0),
    'noise_near_m': (0.0, 120.0),
    'noise_near_exponent': (0.6, 1.5),
    'haze_db': (-10.0, 18.0),
    'haze_m': (10.0, 60.0),
    'noise_correlation_m': (0.08, 0.28),
    'noise_shape': (0.8, 1.3),
    'gain_db': (-4.0, 16.0),
    'gain_drift_db': (0.0, 1.5),
    'noise_drift_db': (0.0, 1.5),
    'sector_gain_db': (0.0, 2.5),
    'knee': (90.0, 140.0),
}
"""Minimum and maximum of each number that `draw_physics` varies."""

HELD_OUT_RANGES: dict[str, tuple[float, float]] = {
    'ghost_db': (-9.0, -5.0),
    'beam_width_rad': (0.055, 0.075),
    'streak_db': (-49.0, -44.0),
    'noise_shape': (1.35, 1.7),
    'knee': (65.0, 85.0),
}
"""Ranges of `held_out_physics` outside those of training: stronger multipath, a wider beam, and so on."""

UNSEEN_RANGES: dict[str, tuple[float, float]] = {
    'texture_exponent': (2.8, 3.3),
    'tail_db': (-26.0, -21.0),
    'beam_width_rad': (0.012, 0.017),
    'range_sigma_m': (0.26, 0.36),
    'haze_db': (19.0, 23.0),
    'noise_correlation_m': (0.32, 0.45),
    'gain_db': (17.0, 20.0),
}
"""Ranges of `unseen_physics` outside those of training: a narrower beam, a coarser range response, more haze."""


_MOST_GHOST_WALLS = 3


def draw_physics(seed: int | np.random.Generator) -> RadarPhysics:
    """A radar for one training world; its speckle is always `RAYLEIGH`."""
    return _draw(np.random.default_rng(seed), TRAINED_RANGES, SpeckleLaw.RAYLEIGH)


def held_out_physics(seed: int | np.random.Generator = 0) -> RadarPhysics:
    """A radar that training never uses: for validation, which chooses the best checkpoint, and for coefficients."""
    rng = np.random.default_rng(seed)
    law = (SpeckleLaw.LOG_NORMAL, SpeckleLaw.K)[int(rng.integers(2))]
    return _draw(rng, TRAINED_RANGES | HELD_OUT_RANGES, law)


def unseen_physics(seed: int | np.random.Generator) -> RadarPhysics:
    """A radar that neither training nor any choice uses: for results alone."""
    return _draw(np.random.default_rng(seed), TRAINED_RANGES | UNSEEN_RANGES, SpeckleLaw.WEIBULL)


def _draw(rng: np.random.Generator, ranges: dict[str, tuple[float, float]], law: SpeckleLaw) -> RadarPhysics:
    drawn = {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
    ceiling = drawn['knee'] + float(rng.uniform(25.0, 60.0))
    integer_powers, ghost_walls = bool(rng.random() < 0.5), int(rng.integers(1, _MOST_GHOST_WALLS + 1))
    return RadarPhysics(**drawn, speckle=law, ceiling=ceiling, integer_powers=integer_powers, ghost_walls=ghost_walls)


def linear_power(decibels: float) -> float:
    """Decibels to linear power."""
    return math.pow(10.0, decibels / 10.0)
