"""Recorded drives: positions of their scans, and scans that a split excludes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import LocalFrame, wrap_angle
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.recorded import RecordedDrive
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.datasets.oxford_writer import write_oxford
from offradar_ros.recordings.datasets.region import Circle, Region
from offradar_ros.recordings.datasets.splits import Split

Street = Callable[..., Any]
ORIGIN = (51.75, -1.25, 70.0)


def test_a_bag_and_a_folder_give_the_same_drive(street: Street, tmp_path: Path) -> None:
    drive = street(count=24)
    write_oxford(drive, tmp_path / 'folder')
    write_bag(drive, tmp_path / 'bag')
    sources = [RecordedDrive(name, str(tmp_path / name), 'w', ORIGIN, 2.2) for name in ('folder', 'bag')]
    folder, bag = (source.open() for source in sources)
    # A scan every 1.25 m: the first in each 2.2 m is kept.
    np.testing.assert_allclose(np.diff(folder.poses[:, 0]).mean(), 2.2, atol=0.15)
    np.testing.assert_allclose(folder.poses, bag.poses, atol=1e-3)
    np.testing.assert_array_equal(folder.scan(3).power, bag.scan(3).power)
    assert (folder.layout, bag.layout) == ('oxford', 'bag')
    assert set(bag.kinds) == {''}
    assert np.isnan(bag.severities).all()
    kept = cached_drives(sources, tmp_path / 'cache', processes=1)
    np.testing.assert_array_equal(kept[1].scan(3).power, bag.scan(3).power)
    np.testing.assert_array_equal(kept[1].poses[:, :2], bag.poses[:, :2])


@pytest.mark.parametrize('form', ['folder', 'bag'])
def test_scans_of_a_recorded_drive_have_a_heading(street: Street, tmp_path: Path, form: str) -> None:
    (write_oxford if form == 'folder' else write_bag)(street(count=24), tmp_path / 'drive')
    drive = RecordedDrive('drive', str(tmp_path / 'drive'), 'w', ORIGIN, 0.0).open()
    # Eastwards, as fixes only tell.
    np.testing.assert_allclose(drive.poses[:, 2], 0.0, atol=1e-3)


def test_a_recorded_heading_is_that_of_the_scan(street: Street, tmp_path: Path) -> None:
    plain = street(count=24)
    track = plain.trajectory
    since_s = (track.stamps_ns - plain.stamps_ns[0]) / 1e9
    askew = plain.with_trajectory(dataclasses.replace(track, yaws_rad=wrap_angle(3.0 + 0.1 * since_s)))
    write_oxford(askew, tmp_path / 'folder')
    drive = RecordedDrive('folder', str(tmp_path / 'folder'), 'w', ORIGIN, 0.0).open()
    expected = 3.0 + 0.1 * (drive.stamps_ns - plain.stamps_ns[0]) / 1e9
    assert np.ptp(wrap_angle(expected)) > 6.0
    np.testing.assert_allclose(np.exp(1j * drive.poses[:, 2]), np.exp(1j * expected), atol=1e-4)


def test_a_split_excludes_scans_from_training(street: Street, tmp_path: Path) -> None:
    write_bag(street(count=24), tmp_path / 'bag')
    # Scan 12 is 15 m east of latitude 51.75°, longitude -1.25°.
    region = Region(32630, (Circle(5_734_682.084, 620_802.167 + 15.0, 3.0),))
    split = Split('s', 'S', 'made', ('other',), ('bag',), region, buffer_m=2.2)
    drive = RecordedDrive('bag', str(tmp_path / 'bag'), 'w', ORIGIN, 0.0, split).open()
    expected = np.abs(1.25 * np.arange(24) - 15.0) > 5.2
    assert 0 < expected.sum() < 24
    np.testing.assert_array_equal(drive.stamps_ns, street(count=24).stamps_ns[expected])


def test_a_split_with_a_region_needs_degrees(street: Street, tmp_path: Path) -> None:
    metric = street(count=6).trajectory.in_frame(LocalFrame(street(count=6).trajectory.origin()))

    class Metric(street):  # type: ignore[misc, valid-type]
        trajectory = metric

    write_bag(Metric(count=6), tmp_path / 'bag')
    split = Split('s', 'S', 'made', ('other',), ('bag',), Region(32630, (Circle(0.0, 0.0, 1.0),)))
    with pytest.raises(DataError, match='bag: expected latitudes and longitudes, as split s has a test region'):
        RecordedDrive('bag', str(tmp_path / 'bag'), 'w', None, 0.0, split).open()


def test_an_unreadable_scan_is_refused_and_left_out_of_a_cache(street: Street, tmp_path: Path) -> None:
    write_oxford(street(count=4), tmp_path / 'a')
    damaged = sorted((tmp_path / 'a' / 'radar').iterdir())[2]
    damaged.write_bytes(damaged.read_bytes()[:500])
    source = RecordedDrive('a', str(tmp_path / 'a'), 'w', ORIGIN, 0.0)
    with pytest.raises(RefusedInput, match=damaged.name):
        source.open().scan(2)
    (kept,) = cached_drives([source], tmp_path / 'cache')
    assert len(kept) == 3
