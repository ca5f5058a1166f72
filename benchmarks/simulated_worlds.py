"""Draw docs/simulated_worlds.png: cities of three seeds, close-ups of three kinds of district, and drives."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.lab.simulation.city import CityPlan, District, make_city
from offradar_ros.lab.simulation.picture import Panel, draw_worlds
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan

OUT = Path(__file__).resolve().parents[1] / 'docs' / 'simulated_worlds.png'
CLOSE_M = 160.0


def panel(title: str, plan: CityPlan, size_m: float | None = None) -> Panel:
    """A city with a drive of 150 s, or only `size_m` around the start of the drive."""
    city = make_city(plan)
    drive = SimulatedSequence(city, SessionPlan(seed=plan.seed, scans=600, start_m=60.0))
    return Panel(title, city, (drive.poses,), size_m)


def main() -> None:
    """Draw six panels."""
    cities = [panel(f'city of seed {seed}, five kinds of district', CityPlan(seed=seed)) for seed in (1, 2, 3)]
    kinds = (District.DENSE, District.SUBURB, District.INDUSTRIAL)
    close = [panel(f'{kind.value}, {CLOSE_M:g} m', CityPlan(seed=4, districts=(kind,)), CLOSE_M) for kind in kinds]
    draw_worlds(OUT, [*cities, *close])
    print(f'{OUT}: drawn')


if __name__ == '__main__':
    main()
