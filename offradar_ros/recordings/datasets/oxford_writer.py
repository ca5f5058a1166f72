"""Any RadarSequence to a folder in the layout of Oxford Radar RobotCar, as that data set's loaders read it.

``radar/<µs>.png`` (rows = azimuths, 11 metadata columns with µs, then power), ``radar.timestamps``, and where positions
are geodetic ``gps/gps.csv`` and ``gps/ins.csv`` (headings in radians clockwise from north). Stamps are cut to
microseconds, the resolution of the layout.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory, geodetic_to_utm
from offradar_ros.radar.navtech_rows import join_rows
from offradar_ros.recordings.new_folder import new_folder
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

LISTING = 'radar.timestamps'
_ENCODER_SIZE = 5600
_GPS = (
    'timestamp,num_satellites,latitude,longitude,altitude,latitude_sigma,longitude_sigma,altitude_sigma,'
    'northing,easting,down,utm_zone'
)
_INS = (
    'timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,'
    'velocity_north,velocity_east,velocity_down,roll,pitch,yaw'
)
# Speckle has no repetitions to find: Huffman coding alone is the fastest, and no larger.
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)


def encode_oxford_png(scan: PolarScan) -> bytes:
    """The bytes of a scan's file; power is kept exactly, azimuths to 1/5600 of a turn."""
    stamps_ns = scan.azimuth_stamps_ns
    if stamps_ns is None:
        stamps_ns = np.full(len(scan.power), scan.stamp_ns, np.int64)
    image = join_rows(dataclasses.replace(scan, azimuth_stamps_ns=stamps_ns // 1000), _ENCODER_SIZE)
    done, data = cv2.imencode('.png', image, _PNG)
    if not done:
        raise DataError(f'scan {scan.stamp_ns}: cannot be encoded as PNG')
    return data.tobytes()


def write_oxford(
    sequence: RadarSequence,
    out: str | Path,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
    encoded: Iterable[bytes] | None = None,
) -> Path:
    """Write the folder, which appears when it is complete, and return it.

    `encoded` are the bytes of the files in order (`encode_oxford_png` of every scan), for a caller that encodes in
    parallel; without it they are encoded here. DataError if the sequence is empty, or `out` exists and may not be
    replaced, or cannot be written.
    """
    out = Path(out)
    if not len(sequence):
        raise DataError(f'{sequence.name}: holds no scans: nothing to write')
    stamps_us = [int(stamp) // 1000 for stamp in sequence.stamps_ns]
    if any(later <= earlier for earlier, later in itertools.pairwise(stamps_us)):
        raise DataError(
            f'{sequence.name}: expected scans at least a microsecond apart, as files are named by their stamp'
        )
    with new_folder(out, overwrite=overwrite, mark=LISTING) as draft:
        (draft / 'radar').mkdir(parents=True)
        files = encoded or (encode_oxford_png(sequence.scan(index)) for index in range(len(sequence)))
        for done, (stamp_us, data) in enumerate(zip(stamps_us, files, strict=True), start=1):
            (draft / 'radar' / f'{stamp_us}.png').write_bytes(data)
            if progress:
                progress(done, len(stamps_us))
        (draft / LISTING).write_text(''.join(f'{stamp_us} 1\n' for stamp_us in stamps_us), encoding='ascii')
        trajectory = sequence.trajectory
        if trajectory is not None and trajectory.geodetic and len(trajectory):
            _write_positions(trajectory, draft / 'gps')
    return out


def _write_positions(trajectory: Trajectory, folder: Path) -> None:
    folder.mkdir()
    latitude, longitude = trajectory.positions[0, :2]
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    utm = geodetic_to_utm(trajectory.positions, (32600 if latitude >= 0.0 else 32700) + zone)
    name = f'{zone}{_band(latitude)}'
    velocities = _velocities(trajectory.stamps_ns, utm)
    with (folder / 'gps.csv').open('w', newline='') as gps_file, (folder / 'ins.csv').open('w', newline='') as ins_file:
        gps, ins = csv.writer(gps_file), csv.writer(ins_file)
        gps.writerow(_GPS.split(','))
        ins.writerow(_INS.split(','))
        rows = zip(trajectory.stamps_ns, trajectory.positions, utm, velocities, trajectory.yaws_rad, strict=True)
        for stamp_ns, position, (easting, northing, _), (east, north, up), yaw in rows:
            place = [f'{position[0]:.9f}', f'{position[1]:.9f}', f'{position[2]:.4f}']
            grid = [f'{northing:.4f}', f'{easting:.4f}', f'{-position[2]:.4f}', name]
            gps.writerow([stamp_ns // 1000, 12, *place, 0.01, 0.01, 0.01, *grid])
            if math.isfinite(yaw):
                motion = [f'{v:.4f}' for v in (north, east, -up)]
                heading = f'{math.remainder(math.pi / 2 - yaw, math.tau):.6f}'
                ins.writerow([stamp_ns // 1000, 'INS_SOLUTION_GOOD', *place, *grid, *motion, 0, 0, heading])


def _band(latitude_deg: float) -> str:
    """UTM's letter for a latitude."""
    return 'CDEFGHJKLMNPQRSTUVWXX'[min(max(int((latitude_deg + 80.0) // 8.0), 0), 20)]


def _velocities(stamps_ns: NDArray[np.int64], points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) metres a second."""
    if len(points_m) < 2:
        return np.zeros_like(points_m)
    return np.asarray(np.gradient(points_m, (stamps_ns - stamps_ns[0]) / 1e9, axis=0))
