"""The ways of the benchmark find the pose of one scan in another, and its pairs are what they say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from alignment_ways import CONDITIONS, ELSEWHERE, ELSEWHERE_M, WITHIN_M, pairs_of
from plane import make_plane
from registration_ways import WAYS, Way

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.types import PolarScan

PLANE = make_plane(1)


@pytest.mark.parametrize('yaw_deg', [4.0, 175.0])
@pytest.mark.parametrize('way', WAYS, ids=lambda way: way.name)
def test_a_way_finds_the_pose_of_the_query_in_the_frame_of_the_place(way: Way, yaw_deg: float) -> None:
    pose = np.array([2.5, -1.5, math.radians(yaw_deg)])
    kept, query = way.keep(PLANE.scan()), way.keep(PLANE.scan((2.5, -1.5, math.radians(yaw_deg)), seed=1))
    found = way.align(way.place(kept), way.query(query))
    assert np.hypot(*(found.pose - pose)[:2]) < 1.0
    assert abs(math.degrees(math.remainder(found.pose[2] - pose[2], 2.0 * math.pi))) < 1.0
    elsewhere = way.align(way.place(way.keep(make_plane(2).scan(seed=2))), way.query(query))
    assert found.score > elsewhere.score
    assert 0 < way.kept_bytes(kept) < 1_000_000


@pytest.mark.parametrize('way', WAYS, ids=lambda way: way.name)
def test_a_scan_without_a_return_is_somewhere(way: Way) -> None:
    scan = PLANE.scan()
    scan.power[:] = 1
    found = way.align(way.place(way.keep(PLANE.scan())), way.query(way.keep(scan)))
    assert np.isfinite(found.pose).all()


def drive(reverse: bool, kinds: list[str]) -> Drive:
    x_m = np.linspace(0.0, 195.0, 40)
    yaw_rad = math.pi if reverse else 0.0
    poses = np.column_stack([x_m, np.full(40, 3.0 * reverse), np.full(40, yaw_rad)])

    def read(index: int) -> PolarScan:
        raise AssertionError(index)

    stamps_ns = np.arange(40)
    return Drive('drive', 'world', 'key', stamps_ns, poses, x_m, np.array(kinds), np.zeros(40), read)


def test_pairs_are_near_or_elsewhere_in_every_condition() -> None:
    drives = [*[drive(False, [''] * 40)] * 2, drive(False, ['blocked'] * 40), drive(True, [''] * 40)]
    pairs = list(pairs_of(drives, 5, np.random.default_rng(1)))
    assert {pair.condition for pair in pairs} == {*CONDITIONS, ELSEWHERE}
    assert len(pairs) == 5 * (len(CONDITIONS) + 1)
    for pair in pairs:
        away_m = float(np.hypot(*pair.pose[:2]))
        assert away_m >= ELSEWHERE_M if pair.condition == ELSEWHERE else away_m <= WITHIN_M
        if pair.condition != ELSEWHERE:
            assert ('other way' in pair.condition) == (abs(pair.pose[2]) > 3.0)
            kinds = {scans.kinds[row] for scans, row in (pair.place, pair.query)}
            assert ('degraded' in pair.condition) == ('blocked' in kinds)
