"""What an evaluation measures, as data: ``params/protocols/NAME.yaml`` holds these records under the same names."""

from __future__ import annotations

import dataclasses

from offradar_ros.errors import ConfigError

PHYSICS = ('nominal', 'drawn', 'held_out', 'unseen')
LEFT_OUT = ('', 'halves')


@dataclasses.dataclass(frozen=True)
class Lane:
    """How one drive through a procedural world differs from the others.

    Attributes:
        left_m: metres to the left of the route's line.
        start_m: where on the route it starts.
        reverse: whether it is driven in the opposite direction.
    """

    left_m: float = 0.0
    start_m: float = 0.0
    reverse: bool = False


@dataclasses.dataclass(frozen=True)
class RealStreets:
    """A nav2 map and recorded traversals of it, in the folder that is given on the command line.

    Attributes:
        name: of the world, in results.
        map: YAML file of the map.
        traversals: TUM files, one for each session.
        seed: of the radar's physics and of each session's noise, traffic and degradations.
        centre_m: (east, north) in metres of the centre of a part of the map; empty for the whole traversals.
        radius_m: scans farther from the centre than this are left out.
    """

    name: str
    map: str
    traversals: tuple[str, ...]
    seed: int
    centre_m: tuple[float, ...] = ()
    radius_m: float = 0.0

    def __post_init__(self) -> None:
        if len(self.traversals) < 2:
            raise ConfigError(f'streets {self.name}: expected at least two traversals, got {len(self.traversals)}')
        if self.centre_m and (len(self.centre_m) != 2 or not self.radius_m > 0.0):
            raise ConfigError(f'streets {self.name}: expected centre_m of two numbers with a radius_m, or neither')


@dataclasses.dataclass(frozen=True)
class Recorded:
    """Recorded traversals of one road, data-set folders or bags in the folder that is given on the command line.

    Attributes:
        name: of the world that they share.
        split: name or file of a split, whose test sequences are mapped and searched for within its test region.
        sequences: further folders that are mapped and searched for.
        maps: folders that are only mapped.
        queries: folders that are only searched for.
    """

    name: str
    split: str = ''
    sequences: tuple[str, ...] = ()
    maps: tuple[str, ...] = ()
    queries: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        named = [*self.sequences, *self.maps, *self.queries]
        if len(set(named)) < len(named):
            raise ConfigError(f'recorded {self.name}: expected each folder once, got {named}')
        if not self.split and not (self.maps or self.sequences):
            raise ConfigError(f'recorded {self.name}: expected a split, sequences or maps')


@dataclasses.dataclass(frozen=True)
class Group:
    """Worlds whose figures are reported together.

    Attributes:
        name: of the group, in results.
        title: of its tables and figures.
        physics: of the simulated radar: ``nominal``, ``drawn`` (at random for each world, as in training) or
            ``held_out`` (outside of what training draws).
        cities: seeds of procedural worlds, of their physics and sessions.
        streets: worlds of real streets.
        recorded: recorded roads.
        paper: number of the paper's table that reports show next to its figures, 0 for none.
    """

    name: str
    title: str
    physics: str = 'drawn'
    cities: tuple[int, ...] = ()
    streets: tuple[RealStreets, ...] = ()
    recorded: tuple[Recorded, ...] = ()
    paper: int = 0

    def __post_init__(self) -> None:
        if self.physics not in PHYSICS:
            raise ConfigError(f'group {self.name}: physics: expected one of {", ".join(PHYSICS)}, got {self.physics!r}')
        if not self.cities and not self.streets and not self.recorded:
            raise ConfigError(f'group {self.name}: expected cities, streets or recorded')
        worlds = [f'city_{seed}' for seed in self.cities]
        worlds += [street.name for street in self.streets] + [road.name for road in self.recorded]
        if len(set(worlds)) < len(worlds):
            raise ConfigError(f'group {self.name}: expected each world once, got {worlds}')
        if self.paper not in (0, 1, 2):
            raise ConfigError(f'group {self.name}: paper: expected 0, 1 or 2, got {self.paper}')

    @property
    def simulated(self) -> bool:
        """Whether any of its scans are simulated."""
        return bool(self.cities or self.streets)

    @property
    def scans(self) -> str:
        """``simulated scans``, ``recorded scans`` or both, in words."""
        if self.simulated and self.recorded:
            return 'simulated and recorded scans'
        return 'simulated scans' if self.simulated else 'recorded scans'


@dataclasses.dataclass(frozen=True)
class Validation:
    """Clean drives, in worlds of no group, whose U gives the static thresholds of introspective querying.

    Attributes:
        cities: seeds of worlds.
        sequences: folders of recorded drives in ordinary conditions.
        physics: as in a group.
        scans: number of scans of each.
        quantile: the threshold is this quantile of U over all their scans.
        levels: N; Δ is the largest |U − 1| over all their scans.
    """

    cities: tuple[int, ...] = ()
    sequences: tuple[str, ...] = ()
    physics: str = 'drawn'
    scans: int = 100
    quantile: float = 0.99
    levels: int = 20

    def __post_init__(self) -> None:
        if self.physics not in PHYSICS:
            raise ConfigError(f'validation: physics: expected one of {", ".join(PHYSICS)}, got {self.physics!r}')
        if self.scans < 1 or self.levels < 1 or not 0.0 < self.quantile <= 1.0:
            raise ConfigError('validation: expected at least one scan and level, and a quantile in (0, 1]')


@dataclasses.dataclass(frozen=True)
class Maintenance:
    """How maps are maintained.

    Attributes:
        match_distance_m: D_t of Algorithm 1.
        random_repeats: draws of the control, which makes as many replacements at random.
    """

    match_distance_m: float = 5.0
    random_repeats: int = 5

    def __post_init__(self) -> None:
        if not self.match_distance_m > 0.0 or self.random_repeats < 1:
            raise ConfigError('maintenance: expected match_distance_m above 0 and random_repeats of at least 1')


@dataclasses.dataclass(frozen=True)
class Protocol:
    """An evaluation.

    Attributes:
        name: of the group, in results.
        title: of its tables and figures.
        groups: what is driven.
        lanes: one drive each through every procedural world.
        scans: scans of each such drive.
        drive_spacing_m: mean path length in metres between two scans of a drive; 0 takes every recorded scan.
        degraded: share of the scans that are degraded.
        map_spacings_m: path length in metres between two places of a map, 0 maps every scan; the first is that of the
            headline figures.
        tolerance_m: a place within this is a positive.
        negative_m: a place farther than this is a negative; between the two a pair counts neither way.
        exclusion_s: if above 0, every drive is also searched for in its own map, without the places that were scanned
            less than this many seconds before or after the query.
        leave_out: ``halves`` makes two maps of each drive, of which either half of the path is left out, so that
            queries there are off the map; empty leaves nothing out, unless `leave_out_m` does.
        leave_out_m: if above 0, two maps are made of each drive: stretches of this path length in metres are mapped
            and left out by turns, and the other way round.
        rejections: shares at which Recall@RR is reported.
        validation: where the static threshold comes from.
        maintenance: how maps are maintained.
        resamples: draws of the bootstrap over pairs.
        seed: of what the evaluation draws at random, apart from the worlds.
    """

    name: str
    title: str
    groups: tuple[Group, ...]
    lanes: tuple[Lane, ...] = ()
    validation: Validation = dataclasses.field(default_factory=Validation)
    maintenance: Maintenance = dataclasses.field(default_factory=Maintenance)
    scans: int = 300
    drive_spacing_m: float = 5.0
    degraded: float = 0.35
    map_spacings_m: tuple[float, ...] = (5.0, 15.0)
    tolerance_m: float = 25.0
    negative_m: float = 50.0
    exclusion_s: float = 0.0
    leave_out: str = ''
    leave_out_m: float = 0.0
    rejections: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    resamples: int = 200
    seed: int = 0

    def __post_init__(self) -> None:
        names = [group.name for group in self.groups]
        if len(set(names)) < len(names) or {ALL, VALIDATION} & set(names):
            raise ConfigError(f'groups: expected different names, none of them {ALL} or {VALIDATION}, got {names}')
        if any(group.cities for group in self.groups) and len(self.lanes) < 2:
            raise ConfigError(f'lanes: expected at least two, got {len(self.lanes)}')
        if self.validation.cities and not self.lanes:
            raise ConfigError('lanes: expected at least one, for the cities of validation')
        if any(group.simulated for group in self.groups) and not self.drive_spacing_m > 0.0:
            raise ConfigError('drive_spacing_m: expected metres above 0 for simulated drives')
        if not self.map_spacings_m or min(*self.map_spacings_m, self.drive_spacing_m, self.exclusion_s) < 0.0:
            raise ConfigError('map_spacings_m, drive_spacing_m, exclusion_s: expected numbers from 0')
        if self.leave_out not in LEFT_OUT or self.leave_out_m < 0.0 or (self.leave_out and self.leave_out_m):
            raise ConfigError(
                'leave_out, leave_out_m: expected halves, or metres above 0, or neither, got '
                f'{self.leave_out!r} and {self.leave_out_m:g}'
            )
        if not 0.0 < self.tolerance_m <= self.negative_m:
            raise ConfigError('tolerance_m, negative_m: expected metres above 0, the second not below the first')
        if not 0.0 <= self.degraded <= 1.0 or not all(0.0 <= r < 1.0 for r in self.rejections):
            raise ConfigError('degraded, rejections: expected shares from 0, and below 1 for rejections')
        if self.scans < 1 or self.resamples < 1:
            raise ConfigError('scans, resamples: expected at least 1')

    @property
    def leaves_out(self) -> bool:
        """Whether a part of each map is left out; such maps are not maintained."""
        return bool(self.leave_out) or self.leave_out_m > 0.0


VALIDATION = 'validation'
"""Name of the group of validation drives."""

ALL = 'all'
"""Key of the figures of all groups together in results."""
