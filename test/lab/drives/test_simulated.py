"""Simulated drives: which scans of a sequence are kept, and their ground truth."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from offradar_ros.errors import DataError
from offradar_ros.geometry import wrap_angle
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.evaluation.protocol import Lane, RealStreets
from offradar_ros.lab.evaluation.simulated_drives import city_drive, street_drive

CITY = city_drive(2_999_999, 0, Lane(), 'drawn', scans=5, spacing_m=5.0, degraded=0.4)


def test_a_cached_drive_is_the_simulated_one(tmp_path: Path) -> None:
    (drive,) = cached_drives([CITY], tmp_path, processes=1)
    sequence, rows, driven_m = CITY.sampled()
    assert len(drive) == len(rows) == 5
    assert (drive.name, drive.world, drive.layout) == ('city_2999999_1', 'city_2999999', 'simulation')
    np.testing.assert_allclose(np.diff(driven_m).mean(), 5.0, atol=1.0)
    np.testing.assert_array_equal(drive.driven_m, driven_m)
    np.testing.assert_array_equal(drive.poses, sequence.poses[rows])
    for row, index in enumerate(rows.tolist()):
        scan, kept = sequence.scan(index), drive.scan(row)
        np.testing.assert_array_equal(kept.power, scan.power)
        np.testing.assert_array_equal(kept.azimuths_rad, scan.azimuths_rad)
        assert (kept.stamp_ns, kept.range_resolution_m) == (scan.stamp_ns, scan.range_resolution_m)
        fault = sequence.degradations[index]
        assert drive.kinds[row] == (fault.kind.value if fault else '')
        assert drive.severities[row] == (fault.severity if fault else 0.0)


def test_a_stride_keeps_every_nth_scan() -> None:
    whole = dataclasses.replace(CITY, spacing_m=0.0, scans=0)
    every = dataclasses.replace(whole, stride=7)
    assert len(whole.sampled().rows) == CITY.plan.scans
    assert every.sampled().rows.tolist() == list(range(0, CITY.plan.scans, 7))
    np.testing.assert_array_equal(every.open().poses, whole.open().poses[::7])


def test_the_heading_of_a_simulated_scan_is_that_of_its_way() -> None:
    plan = dataclasses.replace(CITY.plan, scans=400)
    whole = dataclasses.replace(CITY, plan=plan, spacing_m=0.0, scans=0).open()
    moved = whole.poses[2:, :2] - whole.poses[:-2, :2]
    apart = wrap_angle(whole.poses[1:-1, 2] - np.arctan2(moved[:, 1], moved[:, 0]))
    straight = np.abs(wrap_angle(whole.poses[2:, 2] - whole.poses[:-2, 2])) < 0.02
    assert straight.sum() > 100
    # It weaves in its lane, as drivers do, without turning.
    assert np.degrees(np.abs(apart[straight])).max() < 3.0
    assert np.degrees(np.abs(np.median(apart[straight]))) < 0.3
    assert np.ptp(whole.poses[:, 2]) > 1.0


def test_streets_are_driven_as_recorded(tmp_path: Path) -> None:
    image = np.full((200, 400), 254, np.uint8)
    image[90:96, 20:380] = 0
    cv2.imwrite(str(tmp_path / 'm.png'), image)
    (tmp_path / 'm.yaml').write_text('image: m.png\nresolution: 0.5\norigin: [-100, -50, 0]\n')
    for name, y_m in (('a.tum', -10.0), ('b.tum', -12.0)):
        # The radar is mounted askew: its heading is that of the file, 2 · asin 0.1.
        lines = [f'{0.25 * k} {-80 + 2.0 * k} {y_m} 0 0 0 0.1 0.99498744' for k in range(60)]
        (tmp_path / name).write_text('\n'.join(lines))
    street = RealStreets('toy', 'm.yaml', ('a.tum', 'b.tum'), 7, (0.0, -10.0), 20.0)
    source = street_drive(street, 1, 'nominal', 5.0, 0.0, str(tmp_path))
    poses = source.open().poses
    assert np.hypot(poses[:, 0], poses[:, 1] + 10.0).max() <= 20.0
    np.testing.assert_allclose(poses[:, 1], -12.0, atol=0.5)
    np.testing.assert_allclose(poses[:, 2], 2 * math.asin(0.1), atol=1e-6)
    assert 7 <= len(poses) <= 9
    settings = source.settings()
    moved = dataclasses.replace(street, centre_m=(0.0, 500.0))
    with pytest.raises(DataError, match=r'b\.tum: never within 20 m of the centre'):
        street_drive(moved, 1, 'nominal', 5.0, 0.0, str(tmp_path)).open()
    (tmp_path / 'b.tum').write_text('\n'.join(lines[:40]))
    assert source.settings() != settings
    missing = dataclasses.replace(street, traversals=('a.tum', 'c.tum'))
    with pytest.raises(DataError, match=r'c\.tum: cannot be read'):
        street_drive(missing, 1, 'nominal', 5.0, 0.0, str(tmp_path)).settings()


def test_the_same_files_in_another_folder_are_the_same_street(tmp_path: Path) -> None:
    street = RealStreets('toy', 'm.yaml', ('a.tum', 'a.tum'), 7)
    for name in ('here', 'there'):
        folder = tmp_path / name
        folder.mkdir()
        cv2.imwrite(str(folder / 'm.png'), np.full((20, 20), 254, np.uint8))
        (folder / 'm.yaml').write_text('image: m.png\nresolution: 0.5\norigin: [0, 0, 0]\n')
        (folder / 'a.tum').write_text('0 0 0 0 0 0 0 1\n1 5 0 0 0 0 0 1\n')
    here, there = (street_drive(street, 0, 'drawn', 5.0, 0.0, str(tmp_path / name)) for name in ('here', 'there'))
    assert here.settings() == there.settings()
