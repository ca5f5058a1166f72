"""Commands that read bags of several topics, or without scans."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import RING_KEY
from recorded_topics import compressed_scans, fixes, images, record, scans

from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import FIX_TYPE, IMAGE_TYPE, ChosenTopics

CAR = '/car{}/radar_data/b_scan_image'


@pytest.fixture
def two_cars(street: Callable[..., Any], tmp_path: Path) -> Path:
    """Two radars and two receivers of positions."""
    drives = {1: street(count=4), 2: street(count=6, noise_seed=1)}
    streams = [scans(drive, CAR.format(car)) for car, drive in drives.items()]
    streams += [fixes(drive, f'/car{car}/gps/fix', 0.1 * car) for car, drive in drives.items()]
    return record(tmp_path / 'cars', *streams)


def arguments(command: str, bag: Path, out: Path) -> list[object]:
    """A command that reads a bag."""
    rest: dict[str, list[object]] = {
        'check': [],
        'convert': [out / 'converted'],
        'drive': [*RING_KEY],
        'calibrate': [*RING_KEY, '--out', out / 'params.yaml'],
    }
    return [command, bag, *rest[command]]


COMMANDS = ['check', 'convert', 'drive', 'calibrate']


@pytest.mark.parametrize('command', COMMANDS)
def test_a_choice_of_two_is_an_error_that_the_option_solves(
    offradar: Callable[..., Any], two_cars: Path, tmp_path: Path, command: str
) -> None:
    call = arguments(command, two_cars, tmp_path)
    ran = offradar(*call)
    assert ran.status == 1
    listed = 'choose one with --topic: ' + ', '.join(
        f'{CAR.format(car)} ({IMAGE_TYPE}, 8UC1 400 × 576, {count} messages)' for car, count in ((1, 4), (2, 6))
    )
    assert listed in (ran.out if command == 'check' else ran.err)
    ran = offradar(*call, '--topic', CAR.format(2))
    assert ran.status == 0, ran.err
    if command == 'convert':
        converted = BagSequence(tmp_path / 'converted')
        original = BagSequence(two_cars, topics=ChosenTopics(CAR.format(2)))
        assert len(converted) == 6
        np.testing.assert_array_equal(converted.scan(5).power, original.scan(5).power)
        assert converted.trajectory is not None
        assert original.trajectory is not None
        # Those of the same car.
        assert converted.trajectory.positions[0, 1] == pytest.approx(original.trajectory.positions[0, 1])
    elif command == 'drive':
        assert '6' in ran.out
    elif command == 'check':
        assert f'scans: {CAR.format(2)}' in ran.out
        assert 'positions: /car2/gps/fix' in ran.out


@pytest.mark.parametrize('command', COMMANDS)
def test_a_bag_without_scans_is_a_problem_everywhere(
    offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path, command: str
) -> None:
    silent = record(tmp_path / 'silent', fixes(street(count=3)), empty=[('/radar_data/b_scan_image', IMAGE_TYPE)])
    nothing = record(tmp_path / 'nothing', empty=[('/radar_data/b_scan_image', IMAGE_TYPE), ('/gps/fix', FIX_TYPE)])
    for bag in (silent, nothing):
        ran = offradar(*arguments(command, bag, tmp_path))
        assert ran.status == 1
        expected = f'{bag}: no scans: topic /radar_data/b_scan_image holds no messages'
        if command == 'check':
            assert ('problem ' + expected) in ran.out
        else:
            assert ran.err.splitlines()[-1] == f'error: {expected}'
    assert not (tmp_path / 'converted').exists()
    assert not (tmp_path / 'params.yaml').exists()


@pytest.mark.parametrize('command', COMMANDS)
def test_compressed_scans_beside_a_camera_are_read(
    offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path, command: str
) -> None:
    drive = street(count=6)
    camera = images(drive, '/camera/image_raw', 'rgb8', 48, 64)
    bag = record(tmp_path / 'bag', compressed_scans(drive), camera, fixes(drive))
    ran = offradar(*arguments(command, bag, tmp_path))
    assert ran.status == 0, ran.err + ran.out
    if command == 'convert':
        converted = BagSequence(tmp_path / 'converted')
        for index in range(6):
            np.testing.assert_array_equal(converted.scan(index).power, drive.scan(index).power)


def test_a_drive_maps_by_the_positions_that_are_chosen(
    offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=24)
    bag = record(tmp_path / 'bag', scans(drive), fixes(drive, '/novatel/fix'), fixes(drive, '/ublox/fix', 0.01))
    call = ['drive', bag, *RING_KEY, '--map', tmp_path / 'map.db', '--session', 'first']
    ran = offradar(*call)
    assert ran.status == 1
    assert 'choose one with --positions: /novatel/fix' in ran.err
    ran = offradar(*call, '--positions', '/ublox/fix')
    assert ran.status == 0, ran.err
    assert 'places 0 -> ' in ran.out
    assert 'nothing was mapped' not in ran.out
    # The other receiver is 0.01° further west.
    query = ['drive', bag, *RING_KEY, '--map', tmp_path / 'map.db', '--out', tmp_path / 'answers.csv']
    ran = offradar(*query)
    assert ran.status == 0
    assert 'recall is not known' in ran.err
    wrong = {}
    for positions in ('/ublox/fix', '/novatel/fix'):
        assert offradar(*query, '--positions', positions).status == 0
        rows = list(csv.DictReader((tmp_path / 'answers.csv').open()))
        wrong[positions] = [float(row['error_m']) for row in rows if row['error_m']]
    assert max(wrong['/ublox/fix']) < 50
    assert min(wrong['/novatel/fix']) > 500


def test_a_drive_of_which_no_scan_is_encoded_is_an_error(
    offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=3)
    bag = record(tmp_path / 'bag', images(drive, '/front/image', 'mono8', 480, 640), fixes(drive))
    ran = offradar('drive', bag, *RING_KEY)
    assert ran.status == 1
    assert 'error: ' in ran.err
    assert 'no scan of it could be encoded (3 unknown_range_resolution)' in ran.err


@pytest.mark.parametrize('option', ['--topic', '--positions'])
@pytest.mark.parametrize('command', ['check', 'convert', 'calibrate'])
def test_the_options_are_for_bags(
    refused: Callable[..., str], radiate_folder: Path, tmp_path: Path, command: str, option: str
) -> None:
    call = arguments(command, radiate_folder, tmp_path)
    assert f'{radiate_folder}: is no bag, which {option} is for' in refused(*call, option, '/scan')


def test_a_folder_of_bags_is_read_with_the_same_choice(
    offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path
) -> None:
    for number in (1, 2):
        streams = [scans(street(count=4, noise_seed=number), CAR.format(car)) for car in (1, 2)]
        record(tmp_path / 'bags' / f'drive_{number}', *streams, fixes(street(count=4), '/car1/gps/fix'))
    for call in (['check', tmp_path / 'bags'], ['convert', tmp_path / 'bags', tmp_path / 'out']):
        ran = offradar(*call, '--processes', '1')
        assert ran.status == 1
        assert 'choose one with --topic' in ran.out + ran.err
        ran = offradar(*call, '--processes', '1', '--topic', CAR.format(1))
        assert ran.status == 0, ran.out + ran.err
    for number in (1, 2):
        with Bag(tmp_path / 'out' / f'drive_{number}') as bag:
            assert bag.counts['/radar_data/b_scan_image'] == 4
