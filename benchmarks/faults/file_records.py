"""Sound files of the small forms that are read: tables of positions, pictures, parameters, settings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from faults.record_form import Form, Take, WrongValueTakenError
from offradar_ros.config import RadarConfig, load_config
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.lab.training.config_file import read_config
from offradar_ros.radar.png import decode_png
from offradar_ros.recordings.datasets import positions
from offradar_ros.recordings.datasets.splits import read_split

PARAMS = Path(__file__).resolve().parents[2] / 'params'
US = 1_547_131_010_000_000
ROWS = 12


def file_forms() -> list[Form]:
    """Every form."""
    return [*table_forms(), picture_form(), *yaml_forms()]


def written(suffix: str, read: Callable[[Path], Any]) -> Take:
    """Writes the record to a file and reads that."""

    def take(content: bytes, place: Path) -> None:
        path = place.with_suffix(suffix)
        path.write_bytes(content)
        found = read(path)
        stamps, points = getattr(found, 'stamps_ns', None), getattr(found, 'positions', None)
        if points is not None and not np.isfinite(points).all():
            raise WrongValueTakenError('a position is not finite')
        if stamps is not None and (np.diff(stamps) <= 0).any():
            raise WrongValueTakenError('stamps do not grow')

    return take


def table_forms() -> list[Form]:
    """Tables of positions of each data set."""
    pose = '0.9,-0.1,0,330000.5,0.1,0.9,0,4026000.5,0,0,1,21.5'
    tables: dict[str, tuple[Callable[[Path], Any], list[str]]] = {
        'Oxford gps.csv': (
            positions.read_oxford_gps,
            [
                'timestamp,num_satellites,latitude,longitude,altitude,northing',
                *(f'{US + 200_000 * k},7,{51.76 + 1e-5 * k:.6f},-1.262751,65.1,1' for k in range(ROWS)),
            ],
        ),
        'Oxford ins.csv': (
            positions.read_oxford_ins,
            [
                'timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,velocity_north,'
                'velocity_east,velocity_down,roll,pitch,yaw',
                *(
                    f'{US + 20_000 * k},INS_SOLUTION_GOOD,{51.76 + 1e-6 * k:.7f},-1.26,65.0,5736000,619890,-65,30U,0,0,'
                    '0,0.01,0.02,0.3'
                    for k in range(ROWS)
                ),
            ],
        ),
        'MulRan global_pose.csv': (
            positions.read_global_pose,
            [f'{1561000452974693000 + 10**8 * k},{pose}' for k in range(ROWS)],
        ),
        'MulRan gps.csv': (
            positions.read_mulran_gps,
            [f'{1561000452974693000 + 10**8 * k},36.36,127.36,60.5,0,0,0,0,0,0,0,0,0' for k in range(ROWS)],
        ),
        'Boreas radar_poses.csv': (
            positions.read_radar_poses,
            [
                'GPSTime,easting,northing,altitude,vel_east,vel_north,vel_up,roll,pitch,heading',
                *(f'{US + 250_000 * k},623425.5,4848820.9,154.0,0,0,0,3.1,0.02,0.25' for k in range(ROWS)),
            ],
        ),
        'radar_utm.csv': (
            positions.read_radar_utm,
            ['timestamp_us,utm_e,utm_n,yaw', *(f'{US + 250_000 * k},330000.{k},4026000.5,0.3' for k in range(ROWS))],
        ),
        'TUM trajectory': (
            positions.read_tum,
            ['# seconds x y z', *(f'{0.25 * k:.3f} {k} 2 3 0 0 0 1' for k in range(ROWS))],
        ),
    }
    return [
        Form(name, '\n'.join(lines).encode(), written('.csv', read), 1300, text=True)
        for name, (read, lines) in tables.items()
    ]


def picture_form() -> Form:
    """A polar scan as a PNG."""
    power = np.random.default_rng(0).integers(0, 40, (400, 576), np.uint8)
    _, encoded = cv2.imencode('.png', power)

    def take(content: bytes, _: Path) -> None:
        decode_png(content, 10**9, RadarConfig())

    return Form('PNG scan', encoded.tobytes(), take, 2000)


def yaml_forms() -> list[Form]:
    """Parameters, a protocol, a split, a preset of training."""
    forms: dict[str, tuple[Path, Callable[[Path], Any]]] = {
        'parameter file': (PARAMS / 'offradar.yaml', load_config),
        'protocol': (PARAMS / 'protocols' / 'quick.yaml', read_protocol),
        'split': (PARAMS / 'splits' / 'oxford.yaml', read_split),
        'preset of training': (PARAMS / 'train' / 'smoke.yaml', read_config),
    }
    return [
        Form(name, path.read_bytes(), written('.yaml', read), 1000, text=True) for name, (path, read) in forms.items()
    ]
