"""Queries of each pair of drives are aligned with the nearest places, and drawn over them."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from driven_street import COUNT, driven_street

from offradar_ros.config import CartesianConfig, EncoderConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.alignments import AlignedPair, Aligning, measure_alignments
from offradar_ros.lab.evaluation.methods import Method, OneEncoder, RadVladOfMap
from offradar_ros.lab.evaluation.overlays import brightness, draw_overlays, moved
from offradar_ros.lab.evaluation.protocol import Group, Lane, Protocol
from offradar_ros.lab.evaluation.runner import Worlds
from offradar_ros.radar.cartesian import PolarToCartesian
from offradar_ros.types import PolarScan

LANES_M = (0.0, 1.0, 3.0)
PROTOCOL = Protocol(
    'small', 'One street', (Group('streets', 'a street', cities=(7,)),), (Lane(), Lane()), map_spacings_m=(2.5, 5.0)
)
ALIGNING = Aligning(queries=3, places=2)


@contextlib.contextmanager
def bar(_: str) -> Iterator[Callable[[int, int], None]]:
    yield lambda *_: None


@pytest.fixture(scope='module')
def worlds() -> Worlds:
    drives = [driven_street(lane_m, index=index).drive for index, lane_m in enumerate(LANES_M)]
    return {('streets', 'street'): drives}


@pytest.fixture(scope='module')
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('cache')


def ring_key(name: str = 'ring_key') -> OneEncoder:
    return OneEncoder(name, make_encoder(EncoderConfig(name='ring_key')))


@pytest.fixture(scope='module')
def aligned(worlds: Worlds, cache: Path) -> list[AlignedPair]:
    (found,) = measure_alignments([ring_key()], worlds, PROTOCOL, cache, bar, ALIGNING).values()
    return found


def test_every_ordered_pair_has_queries_in_every_map(aligned: list[AlignedPair]) -> None:
    pairs = [(one.pair.map_index, one.pair.query_index, one.pair.spacing_m) for one in aligned]
    expected = [(m, q, spacing_m) for m, q in itertools.permutations(range(3), 2) for spacing_m in (2.5, 5.0)]
    assert pairs == expected
    for dense, sparse in zip(aligned[::2], aligned[1::2], strict=True):
        assert len(dense.answers) == 3
        np.testing.assert_array_equal(dense.answers.query_rows, sparse.answers.query_rows)
    # Others are drawn for another pair.
    assert len({tuple(one.answers.query_rows.tolist()) for one in aligned}) > 1
    errors_m = np.concatenate([np.hypot(*one.answers.errors[..., :2].reshape(-1, 2).T) for one in aligned])
    assert np.median(errors_m) < 0.3


def test_the_same_is_found_again_and_by_each_method(
    worlds: Worlds, cache: Path, aligned: list[AlignedPair], tmp_path: Path
) -> None:
    methods: list[Method] = [ring_key('one'), RadVladOfMap(tmp_path, 0, 5.0), ring_key('other')]
    found = measure_alignments(methods, worlds, PROTOCOL, cache, bar, ALIGNING)
    # What is fitted to each map has none.
    assert list(found) == ['one', 'other']
    for several in found.values():
        for one, other in zip(several, aligned, strict=True):
            np.testing.assert_array_equal(one.answers.scores, other.answers.scores)
            np.testing.assert_array_equal(one.answers.errors, other.answers.errors)


def test_parts_that_the_protocol_leaves_out_are_left_out(worlds: Worlds, cache: Path) -> None:
    halved = dataclasses.replace(PROTOCOL, leave_out='halves', map_spacings_m=(2.5,), tolerance_m=3.0)
    (found,) = measure_alignments([ring_key()], worlds, halved, cache, bar, ALIGNING).values()
    assert [one.pair.map_number for one in found[:2]] == [1, 2]
    for one in found:
        first_half = one.answers.place_rows < COUNT / 2
        assert first_half.all() if one.pair.map_number == 1 else not first_half.any()
    assert not all(one.answers.on_map.all() for one in found)


def test_nothing_is_aligned_if_nothing_is_asked_for(worlds: Worlds, cache: Path) -> None:
    none = dataclasses.replace(ALIGNING, queries=0)
    assert measure_alignments([ring_key()], worlds, PROTOCOL, cache, bar, none) == {}
    # Maps of fewer places than a query is aligned with are left out.
    many = dataclasses.replace(ALIGNING, places=6)
    (found,) = measure_alignments([ring_key()], worlds, PROTOCOL, cache, bar, many).values()
    assert {one.pair.spacing_m for one in found} == {2.5}


def test_maps_are_made_of_mapped_drives(worlds: Worlds, cache: Path) -> None:
    roles: Worlds = {
        key: [dataclasses.replace(drive, mapped=drive.index == 0, queried=drive.index > 0) for drive in drives]
        for key, drives in worlds.items()
    }
    (found,) = measure_alignments([ring_key()], roles, PROTOCOL, cache, bar, ALIGNING).values()
    assert {(one.pair.map_index, one.pair.query_index) for one in found} == {(0, 1), (0, 2)}


def turned(drive: Drive, quarter: int) -> Drive:
    """The same scans of a radar that is turned counter-clockwise by quarters."""

    def read(row: int) -> PolarScan:
        scan = drive.scan(row)
        return dataclasses.replace(scan, power=np.roll(scan.power, 100 * quarter, axis=0))

    return dataclasses.replace(drive, read_scan=read)


@pytest.mark.parametrize('quarter', [0, 1, 2, 3])
def test_a_scan_is_laid_over_that_of_its_place_by_its_pose(quarter: int) -> None:
    """The place is 10 m behind the query and 3 m to its side; the query may look anywhere."""
    place, query = driven_street(0.0).drive, turned(driven_street(3.0).drive, quarter)
    to_image = PolarToCartesian(CartesianConfig(side_px=320, resolution_m=0.5))
    below = brightness(place.scan(0), to_image)
    above = brightness(query.scan(8), to_image)

    def agreement(x_m: float, y_m: float, quarters: int) -> float:
        laid = moved(above, np.array([x_m, y_m, quarters * np.pi / 2.0]))
        return float((laid * below).sum())

    agreements = {
        (x_m, y_m, turns): agreement(x_m, y_m, turns)
        for x_m, y_m in ((10.0, 3.0), (10.0, -3.0), (-10.0, 3.0), (3.0, 10.0))
        for turns in range(4)
    }
    best = max(agreements, key=lambda pose: agreements[pose])
    assert best == (10.0, 3.0, quarter)


def test_ten_alignments_are_drawn(worlds: Worlds, aligned: list[AlignedPair], tmp_path: Path) -> None:
    pytest.importorskip('matplotlib')
    import cv2  # noqa: PLC0415

    draw_overlays(aligned, worlds, 25.0, tmp_path / 'ten.png')
    draw_overlays(aligned[:1], worlds, 25.0, tmp_path / 'six.png')
    ten, six = (cv2.imread(str(tmp_path / name)) for name in ('ten.png', 'six.png'))
    assert ten is not None
    assert six is not None
    assert ten.shape[1] > 1000
    # Where both scans have returns both colours add up to white on black.
    assert (ten.min(axis=2) > 230).any()
    assert (ten.max(axis=2) < 10).mean() > 0.2
    draw_overlays(aligned, worlds, 0.1, tmp_path / 'none.png')
    assert not (tmp_path / 'none.png').exists()
