"""Several recordings in one frame: folders and bags alike, which scans have positions, and what cannot be joined."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_topics import fixes, record, scans
from street_sequence import Repositioned, StreetSequence

from offradar_ros.config import PositionConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.datasets.oxford_writer import write_oxford
from offradar_ros.recordings.road import Start, open_road, shared_frames, start_of

Street = Callable[..., StreetSequence]


def moved(street: Street, name: str, **changes: Any) -> Repositioned:
    """A drive whose trajectory is changed."""
    drive = street(count=6, name=name)
    return drive.with_trajectory(dataclasses.replace(drive.trajectory, **changes))


def test_a_folder_and_a_bag_of_one_street_are_in_one_frame(street: Street, tmp_path: Path) -> None:
    write_oxford(street(count=24, name='a'), tmp_path / 'a')
    write_bag(street(count=24, lane_m=1.5, name='b'), tmp_path / 'b')
    road = open_road([tmp_path / 'a', tmp_path / 'b'])
    first, second = road.drives
    assert road.notes == []
    assert [(drive.name, drive.layout, len(drive)) for drive in road.drives] == [('a', 'oxford', 24), ('b', 'bag', 24)]
    # The frame starts at the first position of the first drive, a second and 5 m before its first scan.
    np.testing.assert_allclose(first.poses[:, 0], 5.0 + 1.25 * np.arange(24), atol=0.05)
    np.testing.assert_allclose(second.poses[:, :2] - first.poses[:, :2], np.tile([0.0, 1.5], (24, 1)), atol=0.05)
    np.testing.assert_allclose(np.diff(first.driven_m), 1.25, atol=0.05)
    sampled = second.subsampled(5.0)
    assert len(sampled) == 6
    np.testing.assert_array_equal(sampled.stamps_ns, second.sequence.stamps_ns[sampled.rows])
    np.testing.assert_array_equal(sampled.scan(2).power, second.scan(int(sampled.rows[2])).power)
    frame = LocalFrame(GeoPoint(*first.sequence.trajectory.positions[0]))  # type: ignore[union-attr]
    assert sampled.points_lla is not None
    np.testing.assert_allclose(frame.to_enu(sampled.points_lla)[:, :2], sampled.poses[:, :2], atol=1e-6)


def test_scans_without_a_position_are_left_out_and_reported(street: Street, tmp_path: Path) -> None:
    track = street(count=6).trajectory
    for name, kept in (('a', slice(None)), ('b', track.stamps_ns < street(count=6).stamps_ns[4])):
        columns = {key: getattr(track, key)[kept] for key in ('stamps_ns', 'positions', 'yaws_rad')}
        write_bag(moved(street, name, **columns), tmp_path / name)
    road = open_road([tmp_path / 'a', tmp_path / 'b'])
    assert [len(drive) for drive in road.drives] == [6, 4]
    assert road.notes == ['b: 2 of 6 scans have no position: left out']
    # None of the positions, 0.2 s apart, is at the stamp of a scan.
    write_bag(moved(street, 'c', stamps_ns=track.stamps_ns + 37_000_000), tmp_path / 'c')
    with pytest.raises(DataError, match='c: no scan has a position: offradar check says why'):
        open_road([tmp_path / 'c'], position=PositionConfig(max_gap_s=0.1))


def test_an_unreadable_scan_is_refused(street: Street, tmp_path: Path) -> None:
    write_oxford(street(count=4), tmp_path / 'a')
    damaged = sorted((tmp_path / 'a' / 'radar').iterdir())[2]
    damaged.write_bytes(damaged.read_bytes()[:500])
    (drive,) = open_road([tmp_path / 'a']).drives
    with pytest.raises(RefusedInput, match=damaged.name):
        drive.scan(2)
    assert drive.scan(3).power.shape == (400, 576)


def test_positions_in_metres_are_taken_as_they_are(street: Street, tmp_path: Path) -> None:
    metric = street(count=6).trajectory.in_frame(LocalFrame(GeoPoint(51.75, -1.25, 70.0)))
    for name in ('a', 'b'):
        write_bag(moved(street, name, positions=metric.positions, geodetic=False), tmp_path / name)
    road = open_road([tmp_path / 'a', tmp_path / 'b'], name='garage')
    assert road.notes == ['garage: positions are in metres, taken to be of one frame']
    assert [drive.points_lla for drive in road.drives] == [None, None]
    np.testing.assert_allclose(road.drives[0].poses[:, 0], 1.25 * np.arange(6), atol=0.05)


def test_what_is_not_one_road_is_one_line(street: Street, tmp_path: Path) -> None:
    track = street(count=6).trajectory
    write_bag(street(count=6, name='a'), tmp_path / 'a')
    write_bag(moved(street, 'far', positions=track.positions + np.array([1.0, 0.0, 0.0])), tmp_path / 'far')
    write_bag(moved(street, 'metric', geodetic=False), tmp_path / 'metric')
    write_bag(moved(street, 'none', stamps_ns=track.stamps_ns + 10**15), tmp_path / 'none')
    for name, expected in (
        ('far', 'far: over 50 km from .*a$'),
        ('metric', 'metric: expected positions as those of .*a, in degrees or .*cannot be compared$'),
        ('none', 'none: expected positions beside the scans, and there are none$'),
        ('gone', 'gone: no such folder$'),
    ):
        with pytest.raises(DataError, match=expected):
            open_road([tmp_path / 'a', tmp_path / name])


def test_recordings_that_start_near_each_other_share_a_frame(street: Street, tmp_path: Path) -> None:
    write_bag(street(count=6, name='a'), tmp_path / 'a')
    start = start_of(tmp_path / 'a')
    assert (start.path, start.name) == (tmp_path / 'a', 'a')
    assert start.origin is not None
    near, far = (dataclasses.replace(start.origin, latitude_deg=degrees) for degrees in (51.8, 52.5))
    starts = [start, Start(Path('near'), 'near', near), Start(Path('far'), 'far', far)]
    starts += [Start(Path('metric'), 'metric', None), Start(Path('again'), 'again', far)]
    assert [first.name for first in shared_frames(starts)] == ['a', 'a', 'far', 'metric', 'far']


def test_folders_of_one_name_are_distinguished(street: Street, tmp_path: Path) -> None:
    for folder in ('monday', 'friday'):
        write_bag(street(count=3), tmp_path / folder / 'drive')
    road = open_road([tmp_path / 'monday' / 'drive', tmp_path / 'friday' / 'drive'])
    assert [drive.name for drive in road.drives] == ['monday/drive', 'friday/drive']


def test_the_topics_that_are_chosen_are_those_of_every_bag(street: Street, tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ('a', 'b')]
    for path in paths:
        streams = [scans(street(count=3), '/front/scan'), scans(street(count=6), '/rear/scan')]
        record(path, *streams, fixes(street(count=6), '/novatel/fix'), fixes(street(count=6), '/ublox/fix'))
    with pytest.raises(DataError, match='choose one with --topic'):
        open_road(paths)
    with pytest.raises(DataError, match='choose one with --positions'):
        open_road(paths, topics=ChosenTopics('/front/scan'))
    road = open_road(paths, topics=ChosenTopics('/front/scan', '/ublox/fix'))
    assert [len(drive) for drive in road.drives] == [3, 3]
