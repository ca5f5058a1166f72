"""`offradar simulate`: drives through a simulated world, as bags or folders of scans."""

import dataclasses
import enum
from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.cli.progress import progress_bar
from offradar_ros.errors import ConfigError
from offradar_ros.lab.drives.detour import with_detour
from offradar_ros.lab.simulation.degradation import DegradationKind
from offradar_ros.lab.simulation.ground_truth import write_ground_truth
from offradar_ros.lab.simulation.open_world import open_world
from offradar_ros.lab.simulation.prefetch import PrefetchedSequence, prefetch
from offradar_ros.lab.simulation.recorded_path import load_tum
from offradar_ros.lab.simulation.route_sessions import session_plan
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.weather_text import parse_weather
from offradar_ros.radar.profiles import PROFILES
from offradar_ros.recordings.bags.writer import BagOptions, write_bag
from offradar_ros.recordings.datasets.oxford_writer import encode_oxford_png, write_oxford

SCANS = 120


class Format(str, enum.Enum):
    """What a drive is written as."""

    BAG = 'bag'
    OXFORD = 'oxford'


def simulate(
    world: Annotated[str, typer.Argument(help='city, city:SEED, or the YAML file of a nav2 map.')],
    out: Annotated[Path, typer.Option(help='Folder in which to write the drives.')],
    sessions: Annotated[
        Optional[int], typer.Option(min=1, max=100, help='Drives; 3, or one for each traversal.', show_default=False)
    ] = None,
    scans: Annotated[
        Optional[int],
        typer.Option(
            min=1, max=100_000, help=f'Scans of each drive; {SCANS}, or the whole traversal.', show_default=False
        ),
    ] = None,
    traversal: Annotated[
        Optional[list[Path]],
        typer.Option(help='TUM file of a drive to follow, in the frame of the world; sessions take several in turn.'),
    ] = None,
    two_way: Annotated[bool, typer.Option('--two-way', help='Drive every second session backwards.')] = False,
    detour: Annotated[
        float,
        typer.Option(min=0.0, max=1000.0, help='Metres that the last drive goes by streets that the others do not.'),
    ] = 0.0,
    format_: Annotated[Format, typer.Option('--format', help='rosbag2 folders or Oxford-layout folders.')] = Format.BAG,
    sensor: Annotated[str, typer.Option(help=f'Size of the scans: {", ".join(PROFILES)}.')] = 'radiate',
    seed: Annotated[int, typer.Option(min=0, max=10**12, help='Of the world and of the drives.')] = 1,
    degraded: Annotated[float, typer.Option(min=0.0, max=1.0, help='Share of degraded scans in every drive.')] = 0.0,
    kind: Annotated[
        Optional[list[DegradationKind]],
        typer.Option(help='Degradation to draw from; several may be given, all by default.'),
    ] = None,
    weather: Annotated[str, typer.Option(help='clear, or rain=MM_H,snow=MM_H,fog=VISIBILITY_M.')] = 'clear',
    workers: Annotated[int, typer.Option(min=1, max=256, help='Processes; the scans are the same for any number.')] = 2,
    overwrite: Annotated[bool, typer.Option('--overwrite', help='Replace existing drives.')] = False,
) -> None:
    """Simulate several drives through one world; the same seed gives the same drives.

    NAME.csv next to each drive holds the true pose and the degradation of every scan.
    """
    size = _size_of_scans(sensor)
    air, paths = parse_weather(weather), [load_tum(file) for file in traversal or ()]
    place = open_world(world, seed)
    if detour and paths:
        raise ConfigError('--detour: expected a drive along the route of a city, got --traversal too: give only one')
    drives = sessions or len(paths) or 3
    driven_m = (scans or SCANS) * size.rotation_s * SessionPlan().speed_mps
    last_place = with_detour(place, driven_m, detour) if detour else place
    for index in range(drives):
        plan = session_plan(index, scans=scans or SCANS, seed=seed, degraded=degraded)
        plan = dataclasses.replace(
            plan, reverse=two_way and index % 2 == 1, weather=air, kinds=tuple(kind or plan.kinds)
        )
        if paths:
            path = paths[index % len(paths)]
            start_m = float(path.driven_m[-1]) if plan.reverse else 0.0
            length = path.scans(size.rotation_s, start_m=0.0)
            plan = dataclasses.replace(plan, path=path, start_m=start_m, scans=min(scans or length, length))
        elif plan.reverse:
            # It starts where the other drives end, and follows the same streets back.
            plan = dataclasses.replace(plan, start_m=driven_m)
        sequence = SimulatedSequence(last_place if index == drives - 1 else place, plan, size)
        _write(sequence, out / plan.name, format_, overwrite=overwrite, workers=workers)
        write_ground_truth(sequence, out / f'{plan.name}.csv')
        typer.echo(f'{out / plan.name}: written')


def _size_of_scans(sensor: str) -> SimulatedSensor:
    if sensor not in PROFILES:
        raise ConfigError(f'sensor {sensor!r}: expected one of {", ".join(PROFILES)}')
    profile = PROFILES[sensor]
    return SimulatedSensor(profile.azimuths, profile.range_bins, profile.range_resolution_m)


def _write(sequence: SimulatedSequence, out: Path, format_: Format, *, overwrite: bool, workers: int) -> None:
    with progress_bar(f'simulating {sequence.name}') as progress:
        if format_ is Format.BAG:
            write_bag(PrefetchedSequence(sequence, workers), out, BagOptions(plain=True, overwrite=overwrite), progress)
        else:
            encoded = prefetch(sequence, encode_oxford_png, workers)
            write_oxford(sequence, out, overwrite=overwrite, progress=progress, encoded=encoded)
