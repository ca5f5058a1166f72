"""Course over ground against the measured headings of recorded drives, and with noise of a receiver: see README.md."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from recorded_answers import print_head, print_row
from scan_sources import read_arguments

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import LocalFrame, Trajectory, wrap_angle
from offradar_ros.positions.headings import Headings, headings_of
from offradar_ros.recordings.datasets.positions import read_oxford_gps, read_radar_poses, read_radar_utm, read_tum
from offradar_ros.types import Pose

MAX_GAP_NS = round(PositionConfig().max_gap_s * 1e9)
MOVING_MPS = 1.0
"""A vehicle that is slower stands, by the recorded positions."""
SOURCES: dict[str, tuple[str, Callable[[Path], Trajectory]]] = {
    'Boreas, two drives': ('boreas/*.csv', read_radar_poses),
    'MulRan KAIST, three drives': ('mulran_kaist03/*_radar_utm.csv', read_radar_utm),
    'MulRan DCC, three drives': ('worlds/dcc*.tum', read_tum),
}


class Noise(NamedTuple):
    """Error of a receiver: standard deviation in m, time in s after which it is another one, and every how many-th
    position it gives (recorded ones are 4 a second).
    """

    name: str
    sd_m: float
    lasts_s: float = 0.0
    every: int = 1


NOISES = (
    Noise('as recorded', 0.0),
    Noise('as recorded, 1 Hz', 0.0, every=4),
    Noise('0.5 m, new in each', 0.5),
    Noise('0.5 m, new in each, 1 Hz', 0.5, every=4),
    Noise('1.5 m, new in each', 1.5),
    Noise('1.5 m, wanders over 60 s', 1.5, lasts_s=60.0),
)


class Compared(NamedTuple):
    """Headings of a drive compared with measured ones.

    Attributes:
        errors_deg: (N,) course less measured heading, less the median of that: sensors are mounted askew.
        told_deg: (N,) standard deviation that is told of each.
        moving: (N,) whether the vehicle moves.
        askew_deg: the median.
        known_live: share of the positions with a heading in a live stream.
    """

    errors_deg: NDArray[np.float64]
    told_deg: NDArray[np.float64]
    moving: NDArray[np.bool_]
    askew_deg: float
    known_live: float


def recorded_drives(real: Path, pattern: str, reader: Callable[[Path], Trajectory]) -> Iterator[Trajectory]:
    """The drives of a source, in metres."""
    for path in sorted(real.glob(pattern)):
        trajectory = reader(path)
        origin = trajectory.origin()
        yield trajectory.in_frame(LocalFrame(origin) if origin else None)


def noisy(drive: Trajectory, noise: Noise, seed: int) -> Trajectory:
    """The drive as such a receiver has it: a first-order Gauss–Markov process in x and y."""
    kept = slice(None, None, noise.every)
    stamps_ns, positions = drive.stamps_ns[kept], drive.positions[kept].copy()
    steps = np.random.default_rng(seed).normal(0.0, noise.sd_m, (len(positions), 2))
    error = steps[0]
    for row, step_s in enumerate(np.diff(stamps_ns, prepend=stamps_ns[0]) / 1e9):
        kept_share = np.exp(-step_s / noise.lasts_s) if noise.lasts_s else 0.0
        error = kept_share * error + np.sqrt(1.0 - kept_share**2) * steps[row]
        positions[row, :2] += error
    return dataclasses.replace(drive, stamps_ns=stamps_ns, positions=positions, yaws_rad=drive.yaws_rad[kept])


def compare(drive: Trajectory, noise: Noise, seed: int) -> Compared:
    """The course of a drive with noise against the measured headings."""
    received = noisy(drive, noise, seed)
    found = headings_of(received, 'course', MAX_GAP_NS)
    apart_rad = wrap_angle(found[:, 0] - received.yaws_rad)
    askew_rad = float(np.median(apart_rad))
    speeds_mps = np.hypot(*np.gradient(drive.positions[:, :2], drive.stamps_ns / 1e9, axis=0).T)
    live = Headings('course', MAX_GAP_NS)
    left = [
        pose
        for stamp_ns, (x_m, y_m) in zip(received.stamps_ns.tolist(), received.positions[:, :2].tolist(), strict=True)
        for _, pose in live.add(stamp_ns, Pose(x_m, y_m))
    ] + [pose for _, pose in live.settle()]
    return Compared(
        np.degrees(wrap_angle(apart_rad - askew_rad)),
        np.degrees(found[:, 1]),
        speeds_mps[:: noise.every] > MOVING_MPS,
        float(np.degrees(askew_rad)),
        float(np.mean([np.isfinite(pose.yaw_rad) for pose in left])),
    )


def print_source(name: str, drives: list[Trajectory]) -> None:
    """One row for each noise, over all drives of a source."""
    title = (name, 'moving: median', '90 %', 'told', 'within two', 'standing: median', '90 %', 'known live', 'askew')
    print_head(*title)
    for noise in NOISES:
        each = [compare(drive, noise, seed) for seed, drive in enumerate(drives)]
        errors, told, moving = (np.concatenate([part[column] for part in each]) for column in range(3))
        errors = np.abs(errors)
        print_row(
            noise.name,
            *(f'{np.percentile(errors[moving], share):.2f}°' for share in (50, 90)),
            f'{np.median(told[moving]):.2f}°',
            f'{100 * np.mean(errors[moving] <= 2 * told[moving]):.1f} %',
            *(f'{np.percentile(errors[~moving], share):.2f}°' for share in (50, 90)),
            f'{100 * np.mean([part.known_live for part in each]):.1f} %',
            f'{np.mean([part.askew_deg for part in each]):.2f}°',
        )


def print_oxford(real: Path) -> None:
    """What is told of a recorded receiver, of which no heading was measured."""
    for drive in recorded_drives(real, 'oxford_tiny/gps/gps.csv', read_oxford_gps):
        told = np.degrees(headings_of(drive, 'course', MAX_GAP_NS)[:, 1])
        print(f'\nOxford, gps.csv at 5 Hz: {len(told)} positions, told {np.median(told):.2f}°, 90 % ', end='')
        print(f'{np.percentile(told, 90):.2f}°')


def main() -> None:
    """Print a table for each source."""
    real = read_arguments(__doc__ or '').real
    for name, (pattern, reader) in SOURCES.items():
        drives = list(recorded_drives(real, pattern, reader))
        if drives:
            print_source(name, drives)
    print_oxford(real)


if __name__ == '__main__':
    main()
