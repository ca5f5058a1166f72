from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from offradar_ros.errors import ConfigError
from offradar_ros.recordings.datasets.region import Circle, Polygon, Region
from offradar_ros.recordings.datasets.splits import Split, read_split

OXFORD_CENTRE = (5735611.299219, 620540.270327)


def geodesic(latitude: float, longitude: float, bearing_deg: float, distance_m: float) -> list[float]:
    """The point at this bearing and distance on the ellipsoid, without any projection."""
    east, north, _ = pyproj.Geod(ellps='WGS84').fwd(longitude, latitude, bearing_deg, distance_m)
    return [north, east, 70.0]


def centre_lla() -> tuple[float, float]:
    longitude, latitude = pyproj.Transformer.from_crs(32630, 4326, always_xy=True).transform(*OXFORD_CENTRE[::-1])
    return latitude, longitude


@pytest.mark.parametrize('bearing_deg', [0.0, 77.0, 200.0])
def test_a_circle_is_measured_over_the_ground(bearing_deg: float) -> None:
    region = Region(32630, (Circle(*OXFORD_CENTRE, 200.0),))
    distances_m = np.array([0.0, 150.0, 199.0, 201.0, 260.0, 5000.0])
    points = np.array([geodesic(*centre_lla(), bearing_deg, distance_m) for distance_m in distances_m])
    # UTM's scale is within 0.04 % of true here.
    np.testing.assert_allclose(region.outside_m(points), distances_m - 200.0, rtol=5e-4, atol=0.1)


def distance_to_square_m(x: float, y: float, side_m: float) -> float:
    """Signed, from the square between 0 and `side_m`."""
    away = max(-x, x - side_m), max(-y, y - side_m)
    if max(away) <= 0.0:
        return max(away)
    return math.hypot(*(max(0.0, value) for value in away))


def test_a_polygon_is_measured_to_its_sides_and_corners() -> None:
    easting, northing = 620_000.0, 5_735_000.0
    corners = ((0.0, 0.0), (0.0, 100.0), (100.0, 100.0), (100.0, 0.0))
    square = Polygon(tuple((easting + x, northing + y) for x, y in corners))
    offsets = np.random.default_rng(1).uniform(-200.0, 300.0, (50, 2))
    expected = [distance_to_square_m(x, y, 100.0) for x, y in offsets]
    np.testing.assert_allclose(square.outside_m(offsets + np.array([easting, northing])), expected, atol=1e-3)


def test_a_region_is_the_union_of_its_shapes() -> None:
    near, far = Circle(*OXFORD_CENTRE, 200.0), Circle(OXFORD_CENTRE[0] + 1000.0, OXFORD_CENTRE[1], 100.0)
    square = Polygon(((620_000.0, 5_735_000.0), (620_000.0, 5_735_100.0), (620_100.0, 5_735_100.0)))
    latitude, longitude = centre_lla()
    points = np.array([geodesic(latitude, longitude, 0.0, distance_m) for distance_m in (0.0, 600.0, 1000.0)])
    alone = [Region(32630, (near,)), Region(32630, (far,)), Region(32630, (), (square,))]
    expected = np.min([region.outside_m(points) for region in alone], axis=0)
    np.testing.assert_array_equal(Region(32630, (near, far), (square,)).outside_m(points), expected)


def split(**changes: Any) -> Split:
    plain = Split('name', 'Title', 'made', ('a',), ('b', 'c'), Region(32630, (Circle(*OXFORD_CENTRE, 200.0),)))
    return dataclasses.replace(plain, **changes)


def test_the_buffer_belongs_to_neither_side() -> None:
    points = np.array(
        [geodesic(*centre_lla(), 90.0, distance_m) for distance_m in (10.0, 190.0, 210.0, 245.0, 255.0, 900.0)]
    )
    points = np.concatenate([points, np.full((1, 3), np.nan)])
    assert split().tested(points).tolist() == [True, True, False, False, False, False, False]
    assert split().trainable(points).tolist() == [False, False, False, False, True, True, False]
    assert split(buffer_m=0.0).trainable(points).tolist() == [False, False, True, True, True, True, False]


def test_without_a_region_everything_is_tested_and_trained_on() -> None:
    points = np.array([[36.3, 127.4, 0.0], [np.nan] * 3])
    whole = split(region=Region())
    assert whole.tested(points).tolist() == whole.trainable(points).tolist() == [True, False]


def test_the_oxford_split() -> None:
    found = read_split('oxford')
    assert (len(found.test), len(found.train), found.buffer_m, found.region.epsg) == (5, 25, 50.0, 32630)
    assert all(re.fullmatch(r'2019-01-1\d(-\d\d){3}-radar-oxford-10k', name) for name in (*found.test, *found.train))
    assert '2019-01-10-14-36-48-radar-oxford-10k' not in found.train
    assert 'substitute' in found.source
    # The centres lie in Oxford, within two kilometres of each other.
    to_geodetic = pyproj.Transformer.from_crs(32630, 4326, always_xy=True)
    for circle in found.region.circles:
        longitude, latitude = to_geodetic.transform(circle.easting_m, circle.northing_m)
        assert pyproj.Geod(ellps='WGS84').inv(longitude, latitude, -1.2577, 51.7520)[2] < 2500.0
        assert found.region.outside_m(np.array([[latitude, longitude, 0.0]]))[0] < -199.9
    assert len(found.region.circles) == 4


def test_the_mulran_split() -> None:
    found = read_split('mulran')
    assert found.test == ('Riverside01', 'Riverside02')
    assert {name[:-2] for name in found.train} == {'DCC', 'KAIST', 'Sejong'}
    assert len(found.train) == 9
    assert not found.region


WHOLE = 'name: n\ntitle: t\nsource: s\ntest: [a]\ntrain: [b]\n'


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (WHOLE.replace('[a]', '[]'), 'key test: expected at least one sequence'),
        (WHOLE.replace('[b]', '[a]'), 'sequence a: expected once, in test or in train'),
        (WHOLE.replace('[b]', '[../b]'), "key train: expected names of folders, got '../b'"),
        (WHOLE + 'buffer_m: -1\n', 'key buffer_m: expected metres from 0, got -1'),
        (WHOLE + 'region: {epsg: 4326, circles: [{northing_m: 1, easting_m: 1, radius_m: 1}]}', 'a UTM zone'),
        (WHOLE + 'region: {epsg: 32661, polygons: [{vertices: [[0, 0], [0, 1], [1, 1]]}]}', 'a UTM zone'),
        (WHOLE + 'region: {epsg: 32630, circles: [{northing_m: 1, easting_m: 1, radius_m: 0}]}', 'radius_m above 0'),
        (WHOLE + 'region: {epsg: 32630, polygons: [{vertices: [[0, 0], [1, 1]]}]}', 'at least three vertices'),
        (WHOLE + 'region: {epsg: 32630, polygons: [{vertices: [[0, 0], [1, 1], [1]]}]}', 'vertices of two numbers'),
        (WHOLE + 'regin: {}\n', 'key regin is unknown: did you mean region?'),
        (WHOLE.replace('train: [b]\n', ''), 'key train is missing'),
    ],
)
def test_an_error_in_a_split_is_one_line(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        read_split(file)
    assert str(error.value).startswith(f'{file}: ')
    assert expected in str(error.value)
    assert '\n' not in str(error.value)


def test_an_unknown_split_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r'expected a YAML file or one of the splits .* mulran, oxford'):
        read_split('oxfrod')
