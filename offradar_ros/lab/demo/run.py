"""The whole demonstration: simulate, calibrate, replay through the nodes, and show the results."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from rich.console import Console

from offradar_ros.config import load_config
from offradar_ros.errors import DataError, MapError
from offradar_ros.lab.demo.drives import ProgressBars, calibrate_on_clean_drive, simulate_drives
from offradar_ros.lab.demo.live import MAP, replay_drives
from offradar_ros.lab.demo.picture import draw_map
from offradar_ros.lab.demo.report import print_table, what_rejection_saves
from offradar_ros.lab.demo.truth import compare
from offradar_ros.mapping.store import MapStore

MARK = '.offradar_demo'
"""This file marks the folder of a demonstration; other folders are never emptied."""


def run_demo(out: Path, domain_id: int, bars: ProgressBars) -> None:
    """Run the demonstration into `out`, which is emptied first; `bars` show the progress of the long steps."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    _empty(out)
    console = Console()
    console.print(
        'Three drives through a simulated town: the first builds the map, the second improves it, the third queries '
        'it, and for a while leaves the mapped road. Some scans are degraded by faults of six kinds.'
    )
    drives = simulate_drives(out / 'bags', bars)
    params = calibrate_on_clean_drive(out / 'calibrated.yaml', bars)
    replayed = replay_drives(drives, out, params, domain_id, bars)
    stored = MapStore.open_read_only(out / MAP)
    if stored.origin is None:
        raise MapError(f'{out / MAP}: has no origin: no position reached the map server')
    compared = [compare(drive, stored.origin) for drive in replayed]
    print_table(compared, stored.sessions, console)
    console.print(what_rejection_saves(compared[-1]), highlight=False)
    picture = out / 'map.png'
    draw_map(compared[0], compared[-1], load_config(params).query.min_probability, picture)
    console.print(
        f'map drawn in {picture}; the map, the bags, the parameters and the logs are in the same folder',
        highlight=False,
    )


def _empty(out: Path) -> None:
    try:
        if out.exists() and any(out.iterdir()) and not (out / MARK).exists():
            raise DataError(f'{out}: holds other files than those of a demonstration: expected an empty or new folder')
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        (out / MARK).touch()
    except OSError as error:
        raise DataError(f'{out}: cannot be written ({error.strerror})') from error
