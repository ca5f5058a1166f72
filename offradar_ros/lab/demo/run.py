"""Simulate, calibrate, replay through the nodes, and show what came of it."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from rich.console import Console

from offradar_ros.errors import DataError, MapError
from offradar_ros.lab.demo.drives import calibrate_on_a_clean_drive, simulate_drives
from offradar_ros.lab.demo.live import drive_live
from offradar_ros.lab.demo.report import draw_map, print_table
from offradar_ros.lab.demo.truth import judge
from offradar_ros.mapping.store import MapStore

MARK = '.offradar_demo'
"""The file that tells a folder of a demonstration from one that must not be emptied."""


def run_demo(out: Path, domain_id: int) -> None:
    """The whole demonstration; everything it makes is under `out`, which is emptied first."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    _empty(out)
    console = Console()
    console.print(
        'Three drives of one route through a simulated town: the first builds the map, the second improves it, '
        'the third asks it where it is. Some scans are spoiled by faults of six kinds.'
    )
    drives = simulate_drives(out / 'bags')
    params = calibrate_on_a_clean_drive(out / 'calibrated.yaml')
    driven = drive_live(drives, out, params, domain_id)
    stored = MapStore.open_read_only(out / 'map.db')
    if stored.origin is None:
        raise MapError(f'{out / "map.db"}: has no origin: no position reached the map server')
    judged = [judge(each, stored.origin) for each in driven]
    print_table(judged, stored.sessions, console)
    picture = out / 'map.png'
    draw_map(stored.committed(), judged[-1], picture)
    console.print(
        f'map drawn in {picture}; the map, the bags, the parameters and the logs lie beside it', highlight=False
    )


def _empty(out: Path) -> None:
    try:
        if out.exists() and any(out.iterdir()) and not (out / MARK).exists():
            raise DataError(f'{out}: holds something else than a demonstration: choose another folder, or remove it')
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        (out / MARK).touch()
    except OSError as error:
        raise DataError(f'{out}: cannot be written ({error.strerror})') from error
