"""Compare simulated with recorded scans: see README.md."""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path

import cv2
import numpy as np
from scan_pictures import draw_side_by_side, draw_simulated, draw_statistics
from scan_sources import REAL, announce_machine, recorded_sources
from scan_statistics import (
    BANDS_M,
    LAGS_M,
    LAGS_ROWS,
    PANELS,
    QUANTILES,
    Statistics,
    covered,
    energy_distances,
    statistics,
)

from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics, draw_physics
from offradar_ros.lab.simulation.sensor import TRAINING_SENSOR, SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.types import PolarScan

DOCS = Path(__file__).resolve().parents[1] / 'docs'
CITIES = tuple(range(1, 10))
SCANS = 8
DRAWN = 40
DRAWN_SEED = 5_000_000

# Other sensors than those of `NOMINAL_PHYSICS`, fitted to the recorded scans that they are compared with below: that of
# RADIATE records higher, and its bins are means of four; the newest have more noise near them.
RADIATE = dataclasses.replace(
    NOMINAL_PHYSICS,
    integer_powers=False,
    returns_db=4.76,
    texture_exponent=1.85,
    echo_db=-6.0,
    echo_m=9.81,
    occlusion=0.687,
    tail_db=-46.2,
    tail_m=15.2,
    ground_db=3.53,
    ground_exponent=0.4,
    ground_start_m=12.9,
    ground_patch_db=10.0,
    slope_db=11.7,
    slope_share=0.125,
    haze_db=-10.0,
    haze_m=37.4,
    streak_db=-56.3,
    noise_db=0.0,
    noise_near_m=15.4,
    noise_near_exponent=0.821,
    noise_shape=1.05,
    texture_m=1.07,
    incidence_exponent=2.0,
    specular_db=6.52,
    range_sigma_m=0.219,
    gain_db=6.03,
    ghost_db=-23.2,
    diffuse_floor_db=-24.0,
    speckle_correlation_m=0.181,
    noise_correlation_m=0.139,
    beam_width_rad=0.037,
    skirt_db=-44.7,
    skirt_m=1.33,
    side_lobe_db=-39.7,
)
NEWEST = dataclasses.replace(
    NOMINAL_PHYSICS,
    returns_db=10.7,
    range_exponent=1.25,
    texture_exponent=1.59,
    echo_db=-8.03,
    echo_m=8.32,
    occlusion=1.1,
    tail_db=-40.0,
    tail_m=7.7,
    ground_db=-1.42,
    ground_exponent=0.792,
    ground_start_m=19.5,
    ground_patch_db=4.01,
    slope_db=14.3,
    slope_share=0.104,
    haze_db=-1.78,
    haze_m=27.2,
    streak_db=-55.1,
    noise_db=0.0,
    noise_near_m=120.0,
    noise_near_exponent=1.42,
    noise_shape=1.07,
    texture_m=0.889,
    incidence_exponent=2.0,
    specular_db=6.52,
    range_sigma_m=0.142,
    speckle_looks=1.7,
    gain_db=7.1,
    ghost_db=-19.4,
    diffuse_floor_db=-13.2,
    speckle_correlation_m=0.204,
    noise_correlation_m=0.165,
    beam_width_rad=0.0269,
    skirt_db=-35.3,
    side_lobe_db=-27.4,
)
SIMULATED: dict[str, tuple[SimulatedSensor, RadarPhysics, tuple[str, ...]]] = {
    'simulated, 0.0432 m': (
        SimulatedSensor(range_bins=3768, range_resolution_m=0.0432),
        NOMINAL_PHYSICS,
        ('oxford_tiny', 'mulran_kaist03', 'mulran_ray'),
    ),
    'simulated, 0.0438 m': (
        SimulatedSensor(range_bins=6848, range_resolution_m=0.0438),
        NEWEST,
        ('utias_frame', 'navtech_ros2'),
    ),
    'simulated, 0.1736 m': (
        SimulatedSensor(),
        RADIATE,
        ('radiate_tiny_foggy',),
    ),
}


def simulated_scans(sensor: SimulatedSensor, physics: RadarPhysics) -> list[PolarScan]:
    """Scans at large steps through several cities."""
    scans = []
    for seed in CITIES:
        plan = SessionPlan(seed=seed, scans=600, physics=physics)
        sequence = SimulatedSequence(make_city(CityPlan(seed=seed)), plan, sensor)
        scans += [sequence.scan(int(k)) for k in np.linspace(0, len(sequence) - 1, SCANS)]
    return scans


def drawn_scans(sensor: SimulatedSensor) -> list[PolarScan]:
    """A scan each of worlds and radars as training draws them, and of no world that anything is trained on."""
    scans = []
    for seed in range(DRAWN_SEED, DRAWN_SEED + DRAWN):
        plan = SessionPlan(seed=seed, scans=400, physics=draw_physics(seed))
        scans.append(SimulatedSequence(make_city(CityPlan(seed=seed)), plan, sensor).scan(seed % 400))
    return scans


def print_distances(name: str, scans: list[PolarScan], recorded: dict[str, list[PolarScan]]) -> None:
    """Print the distance from recorded scans, and how much of their curves scans of training cover, for each panel."""
    distances, shares = energy_distances(scans, recorded), covered(drawn_scans(SIMULATED[name][0]), recorded)
    for panel, distance, share in zip(PANELS, distances, shares, strict=True):
        print(f'{name:28}{panel:28}{distance:10.3f}{100.0 * share:10.0f} %', flush=True)


def print_speed(sensor: SimulatedSensor) -> None:
    """Print the scans per second that one core renders in a city: the median of 40."""
    cv2.setNumThreads(1)
    sequence = SimulatedSequence(make_city(CityPlan(seed=1)), SessionPlan(seed=1, scans=400), sensor)
    seconds = []
    for index in range(0, 400, 10):
        start = time.process_time()
        sequence.scan(index)
        seconds.append(time.process_time() - start)
    size = f'{sensor.azimuths} × {sensor.range_bins} bins of {sensor.range_resolution_m:g} m'
    print(f'{size}: {1.0 / float(np.median(seconds)):.0f} scans/s of one core')


def print_row(name: str, found: Statistics) -> None:
    """Print a line of the table."""
    print(
        f'{name:28}'
        + ''.join(f'{v:5.0f}' for v in found.quantiles)
        + ' |'
        + ''.join(f'{v:6.1f}' for v in found.bands)
        + ' |'
        + ''.join(f'{v:5.2f}' for v in found.along_range)
        + ' |'
        + ''.join(f'{v:5.2f}' for v in found.along_azimuth),
        flush=True,
    )


def main() -> None:
    """Print the table, and draw the curves and the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--real', type=Path, default=REAL, metavar='FOLDER', help=f'recorded scans (default {REAL})')
    parser.add_argument(
        '--docs', type=Path, default=DOCS, metavar='FOLDER', help='folder of the pictures without recorded scans'
    )
    parser.add_argument(
        '--side-by-side',
        type=Path,
        default=Path('build/simulated_and_recorded.png'),
        metavar='PNG',
        help='picture with recorded scans, whose licence may forbid publishing it',
    )
    arguments = parser.parse_args()
    announce_machine()
    print(
        f'{"bytes (half decibels)":28}'
        + ''.join(f'{100 * q:5.4g}' for q in QUANTILES)
        + ' |'
        + ''.join(f'{f"{low}-{high}":>6}' for low, high in BANDS_M)
        + ' |'
        + ''.join(f'{lag:5.3g}' for lag in LAGS_M)
        + ' |'
        + ''.join(f'{lag:5d}' for lag in LAGS_ROWS)
    )
    print(f'{"":28}{"quantiles, %":>30} |{"mean byte, m":>30} |{"range lag, m":>30} |{"azimuth lag, rows":>30}')
    recorded = dict(recorded_sources(arguments.real, most=6))
    pairs = []
    for name, (sensor, physics, alike) in SIMULATED.items():
        scans = simulated_scans(sensor, physics)
        print_row(name, statistics(scans))
        for source in alike:
            if source in recorded:
                print_row(f'  {source}', statistics(recorded[source]))
        pairs.append((name, scans, {source: recorded[source] for source in alike if source in recorded}))
    if recorded:
        print(f'\n{"":28}{"":28}{"distance":>10}{"covered":>12}')
        for name, scans, alike_scans in pairs:
            print_distances(name, scans, alike_scans)
        draw_statistics(pairs, arguments.docs / 'simulator_statistics.png')
        draw_side_by_side(pairs, arguments.side_by_side)
    draw_simulated(arguments.docs / 'simulated_scans.png')
    for sensor in (TRAINING_SENSOR, SimulatedSensor(), SIMULATED['simulated, 0.0432 m'][0]):
        print_speed(sensor)


if __name__ == '__main__':
    main()
