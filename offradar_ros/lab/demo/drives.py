"""Drives of the demonstration: one route of a simulated town, three times."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from offradar_ros.calibration.one_drive import calibrate_drive
from offradar_ros.config import Config, EncoderConfig, write_parameters
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.route_sessions import session_plan
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.processes import Progress
from offradar_ros.recordings.bags.writer import BagOptions, write_bag

SEED = 1
SCANS = 400
MAPPED = (True, True, False)
DEGRADED = (0.2, 0.2, 0.35)
ENCODER = EncoderConfig(name='variational', weights='compact')


Bars = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of this text, and gives the function of (done, total) that advances it."""


@dataclasses.dataclass(frozen=True)
class Drive:
    """One drive: its bag, whether it is mapped, and the stamps of its degraded scans."""

    name: str
    bag: Path
    mapped: bool
    degraded_ns: frozenset[int]


def simulate_drives(folder: Path, bars: Bars) -> list[Drive]:
    """Write the bags of all drives, seeded."""
    town = make_city(CityPlan(seed=SEED))
    drives = []
    for index, (mapped, degraded) in enumerate(zip(MAPPED, DEGRADED, strict=True)):
        sequence = SimulatedSequence(town, session_plan(index, scans=SCANS, seed=SEED, degraded=degraded))
        with bars(f'simulating {sequence.name}') as progress:
            bag = write_bag(sequence, folder / sequence.name, BagOptions(plain=True, overwrite=True), progress)
        pairs = zip(sequence.stamps_ns, sequence.degradations, strict=True)
        drives.append(Drive(sequence.name, bag, mapped, frozenset(int(s) for s, fault in pairs if fault)))
    return drives


def calibrate_on_a_clean_drive(path: Path, bars: Bars) -> Path:
    """Parameters for the trained encoder from one more drive without degraded scans: Δ spans its U."""
    plan = session_plan(len(MAPPED), scans=SCANS, seed=SEED, degraded=0.0)
    sequence = SimulatedSequence(make_city(CityPlan(seed=SEED)), plan)
    with bars(f'encoding {sequence.name}') as progress:
        calibration = calibrate_drive(sequence, Config(encoder=ENCODER), 0.0, progress)
    write_parameters(path, calibration.values, f'Calibrated over {SCANS} scans of a clean simulated drive.')
    return path
