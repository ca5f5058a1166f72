"""Worlds from the text of a command-line option."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.map_world import load_map_world
from offradar_ros.lab.simulation.world import World

_MAPS = ('.yaml', '.yml')


def open_world(name: str, seed: int) -> World:
    """``city`` (of `seed`), ``city:SEED``, or the path of a nav2 map's YAML file, whose surfaces `seed` draws.

    ConfigError for another name, DataError for a damaged map.
    """
    kind, colon, number = name.partition(':')
    if kind == 'city' and (not colon or (number.isascii() and number.isdigit() and len(number) < 16)):
        return make_city(CityPlan(seed=int(number) if colon else seed))
    if Path(name).suffix.lower() in _MAPS:
        return load_map_world(name, seed)
    raise ConfigError(f'world {name!r}: expected city, city:SEED or the YAML file of a nav2 map')
