"""nav2 maps: which cells are occupied, where they lie, and the walls made from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.simulation.map_image import read_map_image
from offradar_ros.lab.simulation.map_world import load_map_world
from offradar_ros.lab.simulation.recorded_path import load_tum
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan

Map = Callable[..., Path]


@pytest.fixture
def nav2_map(tmp_path: Path) -> Map:
    """Writes a map from pixels and the values of its YAML file that differ from the default."""

    def write(pixels: np.ndarray, **values: object) -> Path:
        cv2.imwrite(str(tmp_path / 'map.png'), pixels)
        lines = {
            'image': 'map.png',
            'mode': 'trinary',
            'resolution': 0.5,
            'origin': [0.0, 0.0, 0.0],
            'negate': 0,
            'occupied_thresh': 0.65,
            'free_thresh': 0.25,
        } | values
        (tmp_path / 'map.yaml').write_text(''.join(f'{k}: {v}\n' for k, v in lines.items() if v is not None))
        return tmp_path / 'map.yaml'

    return write


def expected_occupied(pixels: np.ndarray, mode: str, negate: int, threshold: float) -> np.ndarray:
    """One cell at a time, as nav2's map server reads it."""
    result = np.zeros(pixels.shape[:2], bool)
    for row in range(pixels.shape[0]):
        for column in range(pixels.shape[1]):
            shade = int(pixels[row, column]) / 255.0
            occupancy = shade if negate else 1.0 - shade
            if mode == 'raw':
                percent = int(pixels[row, column])
                result[row, column] = percent <= 100 and percent >= 100 * threshold
            else:
                result[row, column] = occupancy > threshold
    return result


@pytest.mark.parametrize('mode', ['trinary', 'scale', 'raw'])
@pytest.mark.parametrize('negate', [0, 1])
@pytest.mark.parametrize('threshold', [0.3, 0.65])
def test_occupied_cells_are_those_of_the_map_server(nav2_map: Map, mode: str, negate: int, threshold: float) -> None:
    pixels = np.arange(256, dtype=np.uint8).reshape(8, 32)
    image = read_map_image(nav2_map(pixels, mode=mode, negate=negate, occupied_thresh=threshold))
    np.testing.assert_array_equal(image.occupied, expected_occupied(pixels, mode, negate, threshold))


def test_colours_are_averaged_and_transparent_pixels_are_free(nav2_map: Map) -> None:
    pixels = np.zeros((1, 4, 4), np.uint8)
    pixels[0, :, 3] = 255
    pixels[0, 1, :3] = (255, 255, 0)
    pixels[0, 2, 3] = 0
    assert read_map_image(nav2_map(pixels)).occupied.tolist() == [[True, False, False, True]]


@pytest.mark.parametrize('yaw', [0.0, math.pi / 2, -0.7])
def test_walls_lie_relative_to_the_origin(nav2_map: Map, yaw: float) -> None:
    pixels = np.full((40, 60), 254, np.uint8)
    pixels[30:34, 10:50] = 0
    seen = load_map_world(nav2_map(pixels, origin=[100.0, -20.0, yaw])).reflectors
    # Lower left corner of the occupied block in cells from the map's lower left corner: x 10 to 50, y 6 to 10.
    corners = np.array([(10, 6), (50, 6), (50, 10), (10, 10)]) * 0.5
    turned = [
        (100.0 + x * math.cos(yaw) - y * math.sin(yaw), -20.0 + x * math.sin(yaw) + y * math.cos(yaw))
        for x, y in corners.tolist()
    ]
    assert len(seen.walls_m) == 4
    for corner in turned:
        distances = np.hypot(*(seen.walls_m.reshape(-1, 2) - corner).T)
        # Outlines go through the middles of the outermost cells.
        assert distances.min() < 0.36
    assert np.all(seen.wall_transmission < 0.3)


def test_single_cells_are_scatterers_and_a_thin_line_is_one_wall(nav2_map: Map) -> None:
    pixels = np.full((100, 100), 254, np.uint8)
    pixels[50, 20:80] = 0
    pixels[10, 10] = 0
    seen = load_map_world(nav2_map(pixels)).reflectors
    (wall,) = seen.walls_m
    np.testing.assert_allclose(np.sort(wall[:, 0]), [10.25, 39.75])
    np.testing.assert_allclose(wall[:, 1], 24.75)
    assert np.min(np.hypot(*(seen.scatterers_m - (5.25, 44.75)).T)) < 1e-9


def test_straight_outlines_are_buildings_and_ragged_ones_are_vegetation(nav2_map: Map) -> None:
    rng = np.random.default_rng(0)
    pixels = np.full((200, 200), 254, np.uint8)
    pixels[20:60, 20:180] = 0
    for column, row in rng.integers((20, 130), (180, 170), (40, 2)).tolist():
        cv2.circle(pixels, (column, row), 5, 0, -1)
    world = load_map_world(nav2_map(pixels))
    buildings, vegetation = world.reflectors, world.vegetation
    upper = buildings.walls_m[:, :, 1].min(axis=1) > 60.0
    assert upper.sum() == 4
    assert len(vegetation.walls_m) > 20 and vegetation.walls_m[:, :, 1].max() < 60.0
    assert len(vegetation.scatterers_m)
    assert buildings.wall_powers[upper].min() > np.median(vegetation.wall_powers)
    assert buildings.wall_transmission[upper].max() < np.median(vegetation.wall_transmission)


def test_the_same_seed_gives_the_same_surfaces_and_another_seed_others(nav2_map: Map) -> None:
    pixels = np.full((50, 50), 254, np.uint8)
    pixels[10:20, 10:40] = 0
    path = nav2_map(pixels)
    one, same, other = (load_map_world(path, seed).reflectors for seed in (1, 1, 2))
    assert one.wall_powers.tobytes() == same.wall_powers.tobytes() != other.wall_powers.tobytes()
    assert one.walls_m.tobytes() == other.walls_m.tobytes()


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'resolution': 0}, 'resolution: expected 0.001 to 100'),
        ({'resolution': 'fine'}, 'resolution: expected a number'),
        ({'resolution': None}, 'resolution: expected a number'),
        ({'origin': [1, 2]}, 'origin: expected three numbers'),
        ({'origin': [1, '.nan', 0]}, 'origin: expected three numbers'),
        ({'mode': 'binary'}, 'mode: expected trinary, scale, raw'),
        ({'negate': 7}, 'negate: expected 0 or 1'),
        ({'occupied_thresh': 65}, 'occupied_thresh: expected 0 to 1'),
        ({'image': 'other.png'}, 'other.png: cannot be read'),
        ({'image': 'map.yaml'}, 'expected an image'),
        ({'image': [1]}, 'image: expected the name of a file'),
        ({'image': None}, 'expected a nav2 map'),
    ],
)
def test_a_wrong_value_is_reported_with_the_file(nav2_map: Map, values: dict[str, object], message: str) -> None:
    path = nav2_map(np.zeros((4, 4), np.uint8), **values)
    with pytest.raises(DataError, match=message) as caught:
        load_map_world(path)
    assert 'map.yaml' in str(caught.value) and '\n' not in str(caught.value)


@pytest.mark.parametrize('text', ['', '[1, 2]', 'image: [', '\x00', 'a: &a [*a]'])
def test_a_file_that_is_not_a_map_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / 'map.yaml').write_text(text)
    with pytest.raises(DataError):
        load_map_world(tmp_path / 'map.yaml')


def test_an_empty_map_and_a_missing_one_are_refused(nav2_map: Map, tmp_path: Path) -> None:
    with pytest.raises(DataError, match='no cell of the map is occupied'):
        load_map_world(nav2_map(np.full((5, 5), 254, np.uint8)))
    with pytest.raises(DataError, match='cannot be read'):
        load_map_world(tmp_path / 'none.yaml')


def test_a_map_has_no_streets(nav2_map: Map) -> None:
    world = load_map_world(nav2_map(np.zeros((9, 9), np.uint8)))
    with pytest.raises(ConfigError, match='give the drive a recorded path'):
        SimulatedSequence(world, SessionPlan())


@pytest.mark.parametrize('name', ['kaist', 'dcc'])
def test_drives_through_recorded_streets_recognise_places(real_data: Path, name: str) -> None:
    """The mean power by range is more similar at the same place of another drive than elsewhere."""
    world = load_map_world(real_data / 'worlds' / f'{name}.yaml')
    sensor = SimulatedSensor(range_bins=256, range_resolution_m=0.25)
    paths = [load_tum(real_data / 'worlds' / f'{name}0{n}.tum') for n in (1, 2)]
    plans = [SessionPlan(seed=n, path=path, scans=path.scans()) for n, path in enumerate(paths)]
    one, other = (SimulatedSequence(world, plan, sensor) for plan in plans)
    middle = len(one) // 2
    here = one.poses[middle]
    apart = np.hypot(*(other.poses[:, :2] - here[:2]).T) + 50.0 * (1.0 - np.cos(other.poses[:, 2] - here[2]))
    key, near, far = (
        s.scan(int(i)).power[:, 12:].astype(float).mean(axis=0)
        for s, i in ((one, middle), (other, np.argmin(apart)), (other, np.argmax(apart)))
    )
    assert apart.min() < 5.0
    assert np.corrcoef(key, near)[0, 1] > 0.5
    assert np.corrcoef(key, near)[0, 1] > np.corrcoef(key, far)[0, 1]
