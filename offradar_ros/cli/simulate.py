"""`offradar simulate`: drives of a simulated town, as bags."""

from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.bags.writer import BagOptions, write_bag
from offradar_ros.cli.progress import progress_bar
from offradar_ros.simulation.city import CityPlan, make_city
from offradar_ros.simulation.sequence import SimulatedSequence
from offradar_ros.simulation.session_plan import SessionPlan

DAY_NS = 24 * 3600 * 10**9
LANES_M = (0.0, 1.0, -0.8, 0.5, -1.2)


def session_plan(index: int, *, scans: int, seed: int, degraded: float) -> SessionPlan:
    """Drive `index` of a route: each a day later, in a lane offset, traffic and noise of its own."""
    return SessionPlan(
        name=f'session_{index + 1}',
        seed=1000 * seed + index,
        scans=scans,
        left_m=LANES_M[index % len(LANES_M)],
        degraded=degraded,
        start_ns=SessionPlan().start_ns + index * DAY_NS,
    )


def simulate(
    out: Annotated[Path, typer.Argument(help='Folder in which to write the bags.')],
    sessions: Annotated[int, typer.Option(min=1, max=100, help='Drives of the same route.')] = 3,
    scans: Annotated[int, typer.Option(min=1, max=100_000, help='Scans a drive.')] = 120,
    seed: Annotated[int, typer.Option(min=0, help='Of the town and of the drives.')] = 1,
    degraded: Annotated[float, typer.Option(min=0.0, max=1.0, help='Share of degraded scans in every drive.')] = 0.0,
    overwrite: Annotated[bool, typer.Option('--overwrite', help='Replace existing bags.')] = False,
) -> None:
    """Simulate several drives of one route through a procedural town, deterministically by seed."""
    town = make_city(CityPlan(seed=seed))
    for index in range(sessions):
        plan = session_plan(index, scans=scans, seed=seed, degraded=degraded)
        options = BagOptions(plain=True, overwrite=overwrite)
        with progress_bar(f'simulating {plan.name}') as progress:
            path = write_bag(SimulatedSequence(town, plan), out / plan.name, options, progress)
        typer.echo(f'{path}: written')
