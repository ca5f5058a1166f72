"""The scans of the benchmarks: simulated ones, and recorded ones if they are available."""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from offradar_ros import __version__
from offradar_ros.config import RadarConfig
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.messages import scan_from_image
from offradar_ros.recordings.bags.reader import decode_message
from offradar_ros.recordings.bags.topics import IMAGE_TYPE
from offradar_ros.recordings.source import open_source
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

SENSORS = {
    'simulated, 0.1736 m': SimulatedSensor(),
    'simulated, 0.0432 m': SimulatedSensor(range_bins=3768, range_resolution_m=0.0432),
}
RECORDED = ('oxford_tiny', 'mulran_kaist03', 'mulran_ray', 'radiate_tiny_foggy', 'utias_frame')
LIVE = 'navtech_ros2/b_scan_image.cdr'
REAL = Path(os.environ.get('OFFRADAR_REAL_DATA', Path(__file__).resolve().parents[2] / 'shared' / 'real'))


def read_arguments(description: str) -> argparse.Namespace:
    """Parse the options of a benchmark, and print a line about the machine."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--real', type=Path, default=REAL, metavar='FOLDER', help=f'recorded scans (default {REAL})')
    arguments = parser.parse_args()
    announce_machine()
    return arguments


def announce_machine() -> None:
    """Print the versions and the machine."""
    print(
        f'offradar_ros {__version__}, Python {platform.python_version()}, NumPy {np.__version__}, '
        f'OpenCV {cv2.__version__}, {platform.machine()}, {os.cpu_count()} cores'
    )


def scan_sources(real: Path, most: int) -> Iterator[tuple[str, list[PolarScan]]]:
    """The name of each source and up to `most` of its scans at equal steps; recorded ones if available."""
    town = make_city(CityPlan(seed=1))
    for name, sensor in SENSORS.items():
        # 20 s of driving, whatever the number of scans.
        plan = SessionPlan(scans=80, seed=1)
        yield name, _spread(SimulatedSequence(town, plan, sensor), most)
    yield from recorded_sources(real, most)


def recorded_sources(real: Path, most: int) -> Iterator[tuple[str, list[PolarScan]]]:
    """The name of each available recorded source and up to `most` of its scans at equal steps."""
    for name in RECORDED:
        if (real / name).is_dir():
            yield name, _spread(open_source(real / name), most)
    if (real / LIVE).is_file():
        message = decode_message((real / LIVE).read_bytes(), IMAGE_TYPE)
        yield 'navtech_ros2', [scan_from_image(message, RadarConfig())]
    if not real.is_dir():
        print(f'no recorded scans at {real}')


def _spread(sequence: RadarSequence, most: int) -> list[PolarScan]:
    chosen = np.unique(np.linspace(0, len(sequence) - 1, most).round().astype(int))
    return [sequence.scan(int(index)) for index in chosen]
