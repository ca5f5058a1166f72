"""Streams of positions as receivers send them, to be read as a table, from a bag and live."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

SECOND = 10**9
START_NS = 1_767_225_600 * SECOND
PERIOD_NS = SECOND // 10
COUNT = 140
SCANS_NS = START_NS + 2 * SECOND + np.arange(40, dtype=np.int64) * (SECOND // 4)
"""Scans over 10 s; positions start 2 s before them and end 2 s after."""
YEARS_NS = 7 * 365 * 86400 * SECOND


@dataclasses.dataclass(frozen=True)
class Fix:
    """One message of a receiver, and when it arrives."""

    arrival_ns: int
    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 60.0
    variance_m2: float = 0.0


def sound() -> list[Fix]:
    """A drive northwards at 8 m/s."""
    stamps = [START_NS + k * PERIOD_NS for k in range(COUNT)]
    return [Fix(stamp, stamp, 51.75 + 8.0 * k / 10 / 111_250, -1.25) for k, stamp in enumerate(stamps)]


def changed(rows: Sequence[int], change: Callable[[Fix], Fix]) -> list[Fix]:
    """The sound drive with some of its fixes changed."""
    return [change(fix) if k in rows else fix for k, fix in enumerate(sound())]


def at(latitude: float, longitude: float, altitude: float = 60.0) -> Callable[[Fix], Fix]:
    return lambda fix: dataclasses.replace(fix, latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude)


def later(by_ns: int) -> Callable[[Fix], Fix]:
    return lambda fix: dataclasses.replace(fix, stamp_ns=fix.stamp_ns + by_ns)


def altitude(value: float) -> Callable[[Fix], Fix]:
    return lambda fix: dataclasses.replace(fix, altitude_m=value)


def variance(value: float) -> Callable[[Fix], Fix]:
    return lambda fix: dataclasses.replace(fix, variance_m2=value)


FIRST, MIDDLE, MANY = range(5), range(70, 73), range(60, 85)
STREAMS: dict[str, tuple[list[Fix], dict[str, int]]] = {
    'sound': (sound(), {}),
    'zeros at first': (changed(range(50), at(0.0, 0.0, 47.2)), {'no_fix': 50}),
    'zeros in the middle': (changed(MANY, at(0.0, 0.0)), {'no_fix': 25}),
    'nearly zeros': (changed(MIDDLE, at(1e-7, -1e-9)), {'no_fix': 3}),
    'NaN': (changed(MANY, at(math.nan, math.nan, math.nan)), {'no_fix': 25}),
    'a sentinel': (changed(MIDDLE, at(999.0, 999.0)), {'invalid_position': 3}),
    'a large sentinel': (changed(MIDDLE, at(1e10, 1e10, 1e10)), {'invalid_position': 3}),
    'the pole': (changed(MIDDLE, at(90.0, 180.0)), {'invalid_position': 3}),
    'another continent': (changed(MIDDLE, at(-33.9, 151.2)), {'far_position': 3}),
    'another continent at first': (changed(range(30), at(37.4, -122.1)), {'far_position': 30}),
    'no altitude': (changed(range(COUNT), altitude(math.nan)), {}),
    'an altitude now and then': (changed(range(0, COUNT, 3), altitude(math.nan)), {}),
    'an impossible altitude': (changed(MIDDLE, altitude(-99_999.0)), {}),
    'accurate to kilometres': (changed(MANY, variance(1e7)), {'no_fix': 25}),
    'of a receiver in a street': (changed(MANY, variance(400.0)), {}),
    'of unknown variance': (changed(MANY, variance(math.nan)), {}),
    'elsewhere at first': (changed(range(1), at(51.80, -1.25)), {'position_jump': 1}),
    'elsewhere in the middle': (changed(MIDDLE, at(51.753, -1.25)), {'position_jump': 3}),
    'without a longitude in the middle': (changed(MIDDLE, at(51.7504, 0.0)), {'position_jump': 3}),
    'elsewhere at last': (changed(range(138, 140), at(51.80, -1.25)), {'position_jump': 2}),
    'years ahead at first': (changed(FIRST, later(YEARS_NS)), {'position_stamp_jump': 5}),
    'years ahead in the middle': (changed(MIDDLE, later(YEARS_NS)), {'position_stamp_jump': 3}),
    'years back at first': (changed(FIRST, later(-YEARS_NS)), {'position_stamp_jump': 5}),
    'years back in the middle': (changed(MIDDLE, later(-YEARS_NS)), {'position_stamp_jump': 3}),
    '1970 at first': (changed(FIRST, later(-START_NS)), {'position_stamp_jump': 5}),
    '1970 in the middle': (changed(MIDDLE, later(-START_NS)), {'position_stamp_jump': 3}),
    'leap seconds ahead in the middle': (changed(MIDDLE, later(18 * SECOND)), {'position_stamp_jump': 3}),
    'leap seconds back in the middle': (changed(MIDDLE, later(-18 * SECOND)), {'position_stamp_jump': 3}),
    'a little back': (changed([70], later(-2 * PERIOD_NS)), {'position_stamp_backwards': 1}),
    'between two before': (changed([70], later(-3 * PERIOD_NS // 2)), {'position_stamp_backwards': 1}),
    'everything twice': ([fix for fix in sound() for _ in range(2)], {'repeated_position_stamp': COUNT}),
}
"""By name: the stream, and what is left out of it by cause."""
