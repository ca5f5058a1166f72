"""Drives of the demonstration: three on one route of a simulated city, the last one with a detour."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from offradar_ros.calibration.one_drive import calibrate_drive
from offradar_ros.config import Config, EncoderConfig, write_parameters
from offradar_ros.lab.drives.detour import with_detour
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.route_sessions import session_plan
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.processes import Progress
from offradar_ros.recordings.bags.writer import BagOptions, write_bag

SEED = 3
SCANS = 400
MAPPED = (True, True, False)
DEGRADED = (0.2, 0.2, 0.35)
DETOUR_M = 250.0
"""The drive that is not mapped goes at least so far by streets that the others do not use."""
ENCODER = EncoderConfig(name='variational', weights='compact')


ProgressBars = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar with a text, and gives its function of (done, total)."""


@dataclasses.dataclass(frozen=True)
class DemoDrive:
    """One drive: its bag, whether it is mapped, and the stamps of its degraded scans."""

    name: str
    bag: Path
    mapped: bool
    degraded_ns: frozenset[int]


def simulate_drives(folder: Path, bars: ProgressBars) -> list[DemoDrive]:
    """Write the bags of all drives, which are the same each time."""
    city = make_city(CityPlan(seed=SEED))
    drives = []
    for index, (mapped, degraded) in enumerate(zip(MAPPED, DEGRADED, strict=True)):
        plan = session_plan(index, scans=SCANS, seed=SEED, degraded=degraded)
        driven_m = SCANS * SimulatedSensor().rotation_s * plan.speed_mps
        sequence = SimulatedSequence(city if mapped else with_detour(city, driven_m, DETOUR_M), plan)
        with bars(f'simulating {sequence.name}') as progress:
            bag = write_bag(sequence, folder / sequence.name, BagOptions(plain=True, overwrite=True), progress)
        pairs = zip(sequence.stamps_ns, sequence.degradations, strict=True)
        drives.append(DemoDrive(sequence.name, bag, mapped, frozenset(int(s) for s, fault in pairs if fault)))
    return drives


def calibrate_on_clean_drive(path: Path, bars: ProgressBars) -> Path:
    """Write parameters for the encoder, calibrated on the U of one more drive, without degraded scans."""
    plan = session_plan(len(MAPPED), scans=SCANS, seed=SEED, degraded=0.0)
    sequence = SimulatedSequence(make_city(CityPlan(seed=SEED)), plan)
    with bars(f'encoding {sequence.name}') as progress:
        calibration = calibrate_drive(sequence, Config(encoder=ENCODER), 0.0, progress)
    write_parameters(path, calibration.values, f'Calibrated over {SCANS} scans of a clean simulated drive.')
    return path
