"""Check of a bag counts as the nodes do, and compares the clocks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from recorded_topics import record, scans
from rosbags.rosbag2 import StoragePlugin, Writer

from offradar_ros.cli.conversion import convert_sequence
from offradar_ros.config import Config, MapConfig, PositionConfig, load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.recordings.bags.check import check_bag
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import FIX, ODOMETRY, SCANS
from offradar_ros.recordings.bags.writer import BagOptions
from offradar_ros.recordings.drive import drive

CONFIG = load_config(overrides={'encoder.name': 'ring_key'})


def with_radar_clock(path: Path, out: Path, seconds: float) -> Path:
    """The bag with the scans' header stamps later by `seconds`; log times stay."""
    with Bag(path) as bag, Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {topic: kind for topic, kind in bag.topics.items() if topic in (SCANS, FIX)}
        connections = {topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in topics.items()}
        for raw in bag.messages(list(topics)):
            message = bag.decode(raw)
            if raw.topic == SCANS:
                stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec + round(seconds * 1e9)
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            writer.write(connections[raw.topic], raw.log_ns, TYPES.serialize_cdr(message, raw.msgtype))
    return out


@pytest.fixture
def shifted(street: Callable[..., Any], street_bag: Callable[..., Path], tmp_path: Path) -> Callable[[float], Path]:
    source = street_bag('true', count=160)
    return lambda seconds: with_radar_clock(source, tmp_path / f'by_{seconds}', seconds)


def problems(path: Path, position: PositionConfig | None = None) -> list[str]:
    return [problem.text for problem in check_bag(path, position=position).problems]


def mapped(path: Path, config: Config = CONFIG) -> tuple[int, tuple[str, ...]]:
    """How many scans a drive maps, and its warnings."""
    with SessionMap(MapConfig()) as session_map, Bag(path) as bag:
        result = drive(bag, config, make_encoder(config.encoder), session_map, session='one')
    assert result.report is not None
    return result.report.inserted + result.report.replaced + result.report.kept, result.warnings


@pytest.mark.parametrize(
    ('silent', 'rows', 'expected'),
    [
        (slice(0), 300, ['fewer rows than radar.azimuth_samples', 'azimuths missing from the rotation']),
        (slice(100, 200), 400, ['azimuths without any power (partial rotation)']),
    ],
)
def test_what_is_odd_about_rows_is_told_by_check_and_convert(
    street: Callable[..., Any], tmp_path: Path, silent: slice, rows: int, expected: list[str]
) -> None:
    messages = []
    for recorded in scans(street(count=3)):
        power = recorded.message.data.reshape(400, -1)[:rows].copy()
        power[silent] = 0
        recorded.message.height, recorded.message.data = rows, power.reshape(-1)
        messages.append(recorded)
    bag = record(tmp_path / 'bag', messages)
    found = problems(bag)
    assert len(found) == len(expected)
    for text, start in zip(found, expected, strict=True):
        assert text.startswith(start)
        assert text.endswith(f': 3 scans ({", ".join(f"at {stamp} ns" for stamp in BagSequence(bag).stamps_ns)})')
    made = convert_sequence(BagSequence(bag), tmp_path / 'again', BagOptions(), skip_unreadable=False)
    assert list(made.warnings) == found


@pytest.mark.parametrize(
    ('seconds', 'why', 'option'),
    [
        (-37.0, 'TAI is 37 s ahead of UTC', '-37.0'),
        (18.0, 'GPS time is 18 s ahead of UTC', '18.0'),
        (2.5, '2.5 s', '2.5'),
    ],
)
def test_clocks_that_disagree_are_told_of_by_every_command(
    shifted: Callable[[float], Path], seconds: float, why: str, option: str
) -> None:
    path = shifted(seconds)
    (clocks,) = [text for text in problems(path) if 'clocks' in text]
    assert why in clocks
    assert clocks.endswith(f'offradar convert --position-offset-s {option}')
    _, warnings = mapped(path)
    assert [clocks] == [f'{FIX}: {warning}' for warning in warnings]
    trajectory = BagSequence(path).trajectory
    assert trajectory is not None
    assert trajectory.clock_offset_s == pytest.approx(seconds, abs=0.1)


def test_clocks_that_agree_raise_no_alarm(shifted: Callable[[float], Path]) -> None:
    path = shifted(0.0)
    assert problems(path) == []
    assert mapped(path) == (160, ())


@pytest.mark.parametrize('seconds', [-18.0, 0.0, 2.5, 9.0, 12.0, 18.0])
@pytest.mark.parametrize('wait_s', [1.0, 10.0])
def test_check_counts_the_scans_that_a_drive_maps(
    shifted: Callable[[float], Path], seconds: float, wait_s: float
) -> None:
    path = shifted(seconds)
    config = load_config(overrides={'encoder.name': 'ring_key', 'position.wait_s': wait_s})
    found = check_bag(path, position=config.position)
    (text,) = [finding.text for finding in found.findings if 'have a position' in finding.text]
    in_time = text.partition('but only ')[2].partition(' while they wait')[0]
    count = int(in_time or text.removeprefix(f'{FIX}: ').partition(' of ')[0])
    assert count == mapped(path, config)[0]
    if in_time:
        assert f'position.wait_s ({wait_s:g} s)' in text


def test_odometry_is_counted_alike(street_bag: Callable[..., Path]) -> None:
    found = check_bag(street_bag('street', count=20))
    assert any(finding.text.startswith(f'{ODOMETRY}: 20 of 20 scans have') for finding in found.findings)
