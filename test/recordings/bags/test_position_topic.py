"""Which topic of a bag holds the positions of its scans."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from recorded_topics import fixes, record, scans

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE, SCANS, ChosenTopics


def chosen(path: Path, *topics: str, scan_topic: str = SCANS, drive: Any, **options: Any) -> str | None:
    """The topic that is chosen among fixes on `topics`."""
    streams = [fixes(drive, topic, 0.01 * number) for number, topic in enumerate(topics)]
    with Bag(record(path, scans(drive, scan_topic), *streams)) as bag:
        return position_topic(bag, scan_topic, **options)


@pytest.fixture
def drive(street: Callable[..., Any]) -> Any:
    return street(count=2)


@pytest.mark.parametrize(
    ('topics', 'expected'),
    [
        ((), None),
        (('/fix',), '/fix'),
        (('/ublox/fix', '/gps/fix'), '/gps/fix'),
        (('/gps/filtered', '/gps/fix'), '/gps/fix'),
    ],
)
def test_the_only_one_or_that_of_the_usual_name(
    drive: Any, tmp_path: Path, topics: tuple[str, ...], expected: str | None
) -> None:
    assert chosen(tmp_path / 'bag', *topics, drive=drive) == expected


def test_of_two_cars_it_is_that_of_the_same_car(drive: Any, tmp_path: Path) -> None:
    for car in ('car1', 'car2'):
        found = chosen(
            tmp_path / car, '/car1/gps/fix', '/car2/gps/fix', scan_topic=f'/{car}/radar_data/b_scan_image', drive=drive
        )
        assert found == f'/{car}/gps/fix'


def test_where_nothing_decides_all_are_listed_and_the_option_chooses(drive: Any, tmp_path: Path) -> None:
    with pytest.raises(DataError) as refused:
        chosen(tmp_path / 'bag', '/novatel/fix', '/ublox/fix', drive=drive)
    count = len(drive.trajectory)
    assert str(refused.value) == (
        f'{tmp_path / "bag"}: several topics may be the positions, choose one with --positions: '
        f'/novatel/fix ({FIX_TYPE}, {count} messages), /ublox/fix ({FIX_TYPE}, {count} messages); '
        'offradar convert --positions NAME writes a bag of one alone'
    )
    first, second = (
        BagSequence(tmp_path / 'bag', topics=ChosenTopics(positions=name)).trajectory
        for name in ('novatel/fix', '/ublox/fix')
    )
    assert first is not None
    assert second is not None
    assert second.positions[0, 1] - first.positions[0, 1] == pytest.approx(0.01)


def test_whoever_needs_no_positions_need_not_choose(drive: Any, tmp_path: Path) -> None:
    record(tmp_path / 'bag', scans(drive), fixes(drive, '/novatel/fix'), fixes(drive, '/ublox/fix'))
    sequence = BagSequence(tmp_path / 'bag')
    assert sequence.scan(1).power.any()
    with pytest.raises(DataError, match='--positions'):
        _ = sequence.trajectory


def test_an_empty_topic_does_not_count(drive: Any, tmp_path: Path) -> None:
    bag = record(tmp_path / 'bag', scans(drive), fixes(drive, '/fix'), empty=[('/gps/fix', FIX_TYPE)])
    with Bag(bag) as opened:
        assert position_topic(opened, SCANS) == '/fix'


def test_a_type_is_found_whatever_else_there_is(drive: Any, tmp_path: Path) -> None:
    bag = record(tmp_path / 'bag', scans(drive), fixes(drive))
    with Bag(bag) as opened:
        assert position_topic(opened, SCANS, msgtype=ODOMETRY_TYPE) is None
        assert position_topic(opened, SCANS, 'gps/fix', ODOMETRY_TYPE) == '/gps/fix'


@pytest.mark.parametrize(
    ('wanted', 'expected'),
    [
        ('/gps', r'--positions /gps is not in it: expected one of /fix \(sensor_msgs/msg/NavSatFix'),
        (SCANS, r'--positions /radar_data/b_scan_image is sensor_msgs/msg/Image: expected one of /fix '),
        ('/silent', '--positions /silent: holds no messages'),
    ],
)
def test_a_wrong_choice_is_named(drive: Any, tmp_path: Path, wanted: str, expected: str) -> None:
    bag = record(tmp_path / 'bag', scans(drive), fixes(drive, '/fix'), empty=[('/silent', FIX_TYPE)])
    with pytest.raises(DataError, match=expected):
        BagSequence(bag, topics=ChosenTopics(positions=wanted))
