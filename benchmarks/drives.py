"""The input of the benchmarks of running nodes: a simulated drive, and a map to search."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
from sample_signatures import packed_turns

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.config import MapConfig, RadarConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, scan_from_image
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import scan_topic
from offradar_ros.recordings.bags.topics import FIX_TYPE
from offradar_ros.types import Embedding, PolarScan, Pose

SEED = 1
SCANS = 80
SENSOR = 'cts350x'
SPREAD_M = 50.0
"""Spacing of the places of that map, more than any match distance."""


def offradar(*words: object) -> None:
    """Run a command of the package in a new process; SystemExit if it fails."""
    command = [sys.executable, '-m', 'offradar_ros.cli.main', *map(str, words)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    if done.returncode:
        raise SystemExit(f'error: {" ".join(command)}: exit status {done.returncode}')


def simulated_drive(folder: Path, layout: str = 'bag') -> Path:
    """A drive of 80 full-size scans (400 × 3768 bins) as a bag or an Oxford folder, made once."""
    made = folder / layout
    if not made.is_dir():
        options = ('--sessions', 1, '--scans', SCANS, '--seed', SEED, '--sensor', SENSOR, '--format', layout)
        draft = made.with_name(f'{layout}.partial')
        offradar('simulate', 'city', '--out', draft, '--overwrite', *options)
        draft.rename(made)
    return next(path for path in sorted(made.iterdir()) if path.is_dir())


def decoded_scans(bag_path: Path, most: int) -> list[PolarScan]:
    """The first scans of a bag."""
    with Bag(bag_path) as bag:
        messages = itertools.islice(bag.messages([scan_topic(bag)]), most)
        return [scan_from_image(bag.decode(message), RadarConfig()) for message in messages]


def origin_of(bag_path: Path) -> GeoPoint:
    """The first position of the drive."""
    with Bag(bag_path) as bag:
        return point_from_fix(bag.decode(next(bag.messages(bag.topics_of(FIX_TYPE)))))


def write_map(path: Path, info: ModelInfo, drive: Path, places: int) -> Path:
    """Write a map with one ended session of `places` places, with random L2-normalised descriptors of this model.

    Their signatures are those of scans of the drive, each turned by another angle.
    """
    path.unlink(missing_ok=True)
    signatures = packed_turns(list(map(SignatureMaker(), decoded_scans(drive, SCANS))), places)
    rng = np.random.default_rng(SEED)
    side = int(np.ceil(places**0.5))
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(info)
        session_map.set_origin(origin_of(drive))
        session_map.start_session('random places', 0)
        for number in range(places):
            mean = rng.standard_normal(info.dimension).astype(np.float32)
            row, column = divmod(number, side)
            mean /= np.linalg.norm(mean)
            variance = np.ones(info.dimension, np.float32)
            embedding = Embedding(number + 1, mean, variance, info.fingerprint, signatures[number])
            # Far from the drive, whose scans are inserted as new places.
            session_map.merge(embedding, Pose(5_000.0 + row * SPREAD_M, 5_000.0 + column * SPREAD_M))
        session_map.end_session()
    return path
