"""Parameters of a simulated city."""

from __future__ import annotations

import dataclasses
import enum

from offradar_ros.errors import ConfigError


class District(str, enum.Enum):
    """Kinds of districts. Two districts of one kind differ in all measures that are drawn for them (`Style`)."""

    DENSE = 'dense'
    SUBURB = 'suburb'
    PARK = 'park'
    OPEN = 'open'
    INDUSTRIAL = 'industrial'


@dataclasses.dataclass(frozen=True)
class CityPlan:
    """Parameters of a city; the same plan makes the same city.

    Attributes:
        seed: seed of everything that is random.
        blocks: number of blocks, east and north before the city is rotated; a margin of one block surrounds them.
        block_m: mean distance between streets, metres, with a standard deviation of about a quarter.
        districts: kinds of districts; there is about one district for every four blocks.
        route_m: minimum length of the world's route.
        closed: whether that route is a loop.
    """

    seed: int = 0
    blocks: tuple[int, int] = (5, 4)
    block_m: float = 110.0
    districts: tuple[District, ...] = tuple(District)
    route_m: float = 1500.0
    closed: bool = True

    def __post_init__(self) -> None:
        if min(self.blocks) < 1 or max(self.blocks) > 40:
            raise ConfigError(f'blocks of a city: expected 1 to 40 east and north, got {self.blocks}')
        if not 50.0 <= self.block_m <= 1000.0:
            raise ConfigError(f'block_m of a city: expected 50 to 1000 metres, got {self.block_m:g}')
        if not self.districts:
            raise ConfigError('districts of a city: expected at least one kind')
        if not 0.0 <= self.route_m <= 1e5:
            raise ConfigError(f'route_m of a city: expected up to 100000 metres, got {self.route_m:g}')
