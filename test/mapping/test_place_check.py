"""A place that cannot be stored or searched is told by its id and what is wrong with it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from offradar_ros.mapping.place_check import (
    MAX_COORDINATE_M,
    MAX_MEAN_VALUE,
    MAX_PLACE_ID,
    MAX_SESSION_ID,
    place_problem,
)
from offradar_ros.positions.rules import END_NS
from offradar_ros.types import PlaceTable


def table() -> PlaceTable:
    """Three places at the edges of what is valid."""
    return PlaceTable(
        place_ids=np.array([0, 7, MAX_PLACE_ID]),
        session_ids=np.array([0, 1, MAX_SESSION_ID], np.int32),
        stamps_ns=np.array([0, 1, END_NS - 1]),
        positions_m=np.array([[0.0, -MAX_COORDINATE_M, 0.0], [1.0, 2.0, 3.0], [MAX_COORDINATE_M, 0.0, 0.0]]),
        yaws_rad=np.array([math.nan, -2 * math.pi, 40 * math.pi]),
        yaw_sds_rad=np.array([math.nan, 0.0, math.pi], np.float32),
        uncertainties=np.array([0.0, 1.0, np.finfo(np.float32).max], np.float32),
        means=np.array([[0.0, 1.0], [2.0, 3.0], [-MAX_MEAN_VALUE, 1.0]], np.float32),
    )


def test_values_at_the_edges_are_valid() -> None:
    assert place_problem(table()) is None
    assert place_problem(PlaceTable.from_places([], 5)) is None


@pytest.mark.parametrize(
    ('column', 'value', 'problem'),
    [
        ('place_ids', -1, 'place -1 has an id outside'),
        ('place_ids', MAX_PLACE_ID + 1, 'has an id outside'),
        ('session_ids', -1, 'place 7 has a session id outside'),
        ('stamps_ns', -1, 'place 7 has a stamp outside'),
        ('stamps_ns', END_NS, 'place 7 has a stamp outside'),
        ('positions_m', math.nan, 'place 7 has a position outside'),
        ('positions_m', math.inf, 'place 7 has a position outside'),
        ('positions_m', 1.01e8, 'place 7 has a position outside'),
        ('yaws_rad', math.inf, 'place 7 has a heading outside ±1e+06 rad'),
        ('yaws_rad', 1e308, 'place 7 has a heading outside ±1e+06 rad'),
        ('yaw_sds_rad', -0.01, 'place 7 has a heading whose standard deviation is outside 0 to π'),
        ('yaw_sds_rad', 3.2, 'place 7 has a heading whose standard deviation is outside 0 to π'),
        ('yaw_sds_rad', math.inf, 'place 7 has a heading whose standard deviation is outside 0 to π'),
        ('uncertainties', math.nan, 'place 7 has a U that is not finite'),
        ('uncertainties', math.inf, 'place 7 has a U that is not finite'),
        ('uncertainties', -1e-9, 'place 7 has a U that is not finite or below 0'),
        ('means', math.nan, 'place 7 has a mean that is not finite'),
        ('means', -math.inf, 'place 7 has a mean that is not finite'),
        ('means', 1.01 * MAX_MEAN_VALUE, 'place 7 has a mean that is not finite or beyond'),
    ],
)
def test_one_wrong_value_is_found(column: str, value: float, problem: str) -> None:
    places = table()
    getattr(places, column)[1, ...] = value
    assert problem in (place_problem(places) or '')
    if getattr(places, column).ndim == 2:
        for part in range(getattr(places, column).shape[1]):
            places = table()
            getattr(places, column)[1, part] = value
            assert problem in (place_problem(places) or '')


def test_a_session_id_that_32_bits_do_not_hold_is_found() -> None:
    places = dataclasses.replace(table(), session_ids=np.array([0, MAX_SESSION_ID + 1, 1]))
    assert 'place 7 has a session id outside' in (place_problem(places) or '')
