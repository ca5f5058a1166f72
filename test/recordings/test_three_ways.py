"""One recording gets one answer: as a table, from a bag, by check, by drive's order and by live arrival."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from position_streams import SCANS_NS, STREAMS, Fix
from rosbags.rosbag2 import StoragePlugin, Writer

from offradar_ros.config import Config, MapConfig, PositionConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, stamp_ns
from offradar_ros.recordings.bags.check import check_bag
from offradar_ros.recordings.bags.positions import arrivals, read_positions
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.topics import FIX, FIX_TYPE, IMAGE_TYPE, SCANS
from offradar_ros.recordings.datasets.positions import read_mulran_gps, read_oxford_gps
from offradar_ros.recordings.replayed_positions import count_positioned
from offradar_ros.stages.map import MapStage
from offradar_ros.types import Embedding

MODEL = ModelInfo('stub', 'ab' * 32, 2, {})
MAX_GAP_NS = 1_500_000_000
ORIGIN = GeoPoint(51.75, -1.25, 0.0)


def message(fix: Fix) -> Any:
    types = TYPES.types
    stamp = types['builtin_interfaces/msg/Time'](sec=fix.stamp_ns // 10**9, nanosec=fix.stamp_ns % 10**9)
    return types[FIX_TYPE](
        header=types['std_msgs/msg/Header'](stamp=stamp, frame_id='gps'),
        status=types['sensor_msgs/msg/NavSatStatus'](status=0, service=1),
        latitude=fix.latitude_deg,
        longitude=fix.longitude_deg,
        altitude=fix.altitude_m,
        position_covariance=np.diag([fix.variance_m2] * 3).reshape(-1),
        position_covariance_type=2 if fix.variance_m2 else 0,
    )


def scan_message(stamp: int) -> Any:
    types = TYPES.types
    time = types['builtin_interfaces/msg/Time'](sec=stamp // 10**9, nanosec=stamp % 10**9)
    power = np.random.default_rng(stamp).integers(1, 200, (400, 576), np.uint8)
    return types[IMAGE_TYPE](
        header=types['std_msgs/msg/Header'](stamp=time, frame_id='radar'),
        height=400,
        width=576,
        encoding='8UC1',
        is_bigendian=0,
        step=576,
        data=power.reshape(-1),
    )


def bag_of(path: Path, fixes: list[Fix]) -> Path:
    messages = [(int(stamp), SCANS, IMAGE_TYPE, scan_message(int(stamp))) for stamp in SCANS_NS]
    messages += [(fix.arrival_ns, FIX, FIX_TYPE, message(fix)) for fix in fixes]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=TYPES)
            for topic, kind in ((SCANS, IMAGE_TYPE), (FIX, FIX_TYPE))
        }
        for log_ns, topic, kind, each in sorted(messages, key=lambda item: item[0]):
            writer.write(connections[topic], log_ns, TYPES.serialize_cdr(each, kind))
    return path


def cell(value: float) -> str:
    return '' if math.isnan(value) else repr(value)


def oxford_table(path: Path, fixes: list[Fix]) -> Path:
    rows = [
        f'{fix.stamp_ns / 1e9:.9f},{cell(fix.latitude_deg)},{cell(fix.longitude_deg)},{cell(fix.altitude_m)}'
        for fix in fixes
    ]
    path.write_text('\n'.join(['timestamp,latitude,longitude,altitude', *rows]) + '\n')
    return path


def exact_table(path: Path, fixes: list[Fix]) -> Path:
    """As MulRan writes it: no header, whole nanoseconds."""
    rows = [
        f'{fix.stamp_ns},{fix.latitude_deg!r},{fix.longitude_deg!r},{fix.altitude_m!r},'
        + ','.join(map(str, np.diag([fix.variance_m2] * 3).reshape(-1)))
        for fix in fixes
    ]
    path.write_text('\n'.join(rows) + '\n')
    return path


def poses_of(trajectory: Trajectory) -> dict[int, list[float]]:
    poses = trajectory.in_frame(LocalFrame(ORIGIN)).poses_at(SCANS_NS, MAX_GAP_NS)
    return {int(s): p[:2].tolist() for s, p in zip(SCANS_NS, poses, strict=True) if np.isfinite(p[0])}


def live(fixes: list[Fix], ahead_ns: int) -> tuple[dict[int, list[float]], Counter[str]]:
    """Mapped scans with their positions in the frame of ORIGIN, each scan after the fixes up to `ahead_ns` later."""
    causes: Counter[str] = Counter()
    with SessionMap(MapConfig(match_distance_m=0.01)) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(Config(), session_map)
        stage.start_session(0)
        events: list[tuple[int, int, Fix | int]] = [(fix.arrival_ns, 0, fix) for fix in fixes]
        events += [(int(stamp) + ahead_ns, 1, int(stamp)) for stamp in SCANS_NS]
        for _, _, event in sorted(events, key=lambda item: item[:2]):
            try:
                if isinstance(event, Fix):
                    sent = message(event)
                    stage.add_point(stamp_ns(sent.header.stamp), point_from_fix(sent))
                else:
                    values = np.full(2, event % 1000, np.float32)
                    stage.add_embedding(Embedding(event, values, np.ones(2, np.float32), MODEL.fingerprint))
            except RefusedInput as refused:
                causes[refused.cause] += 1
        stage.end_session()
        causes.update({left_out.cause: left_out.count for left_out in stage.take_left_out()})
        places = session_map.places()
        assert session_map.origin is not None
        lla = LocalFrame(session_map.origin).to_geodetic(places.positions_m)
    metric = LocalFrame(ORIGIN).to_enu(lla)[:, :2]
    return dict(zip(places.stamps_ns.tolist(), metric.tolist(), strict=True)), causes


@pytest.mark.parametrize('name', STREAMS)
def test_every_way_gives_the_same_scans_the_same_positions(tmp_path: Path, name: str) -> None:
    fixes, expected = STREAMS[name]
    with Bag(bag_of(tmp_path / 'bag', fixes)) as bag:
        from_bag, bag_causes = read_positions(bag, FIX)
        used = set(from_bag.stamps_ns.tolist())
        usable = [(log_ns, stamp) for log_ns, stamp, _ in arrivals(bag, FIX) if stamp in used]
        counted = count_positioned([(int(s), int(s)) for s in SCANS_NS], usable, PositionConfig(), 1.0)
    table_causes: Counter[str] = Counter()
    from_table = read_mulran_gps(exact_table(tmp_path / 'gps.csv', fixes), table_causes)
    wanted = poses_of(from_bag)
    assert len(wanted) >= 24
    assert bag_causes == Counter(expected)
    # A table shows the unit of a stamp by its magnitude, which 0 does not have.
    assert table_causes == Counter(expected) or name.startswith('1970')
    assert table_causes.total() == bag_causes.total()
    assert poses_of(from_table) == wanted
    assert counted == len(wanted)
    for ahead_ns in (0, MAX_GAP_NS):
        mapped, live_causes = live(fixes, ahead_ns)
        assert mapped.keys() == wanted.keys()
        for stamp, position_m in wanted.items():
            assert mapped[stamp] == pytest.approx(position_m, abs=0.01)
        assert live_causes == Counter(expected)


@pytest.mark.parametrize('name', ['sound', 'zeros at first', 'NaN', 'no altitude', 'years ahead at first'])
def test_check_says_what_is_left_out(tmp_path: Path, name: str) -> None:
    fixes, expected = STREAMS[name]
    found = check_bag(bag_of(tmp_path / 'bag', fixes))
    texts = [problem.text for problem in found.problems]
    assert len([text for text in texts if 'left out' in text]) == len(expected)
    for count in expected.values():
        assert any(f'{FIX}: {count} positions left out: ' in text for text in texts)


def test_a_table_with_decimal_seconds_and_empty_cells_is_read_as_the_bag(tmp_path: Path) -> None:
    fixes, expected = STREAMS['NaN']
    tally: Counter[str] = Counter()
    trajectory = read_oxford_gps(oxford_table(tmp_path / 'gps.csv', fixes), tally)
    assert tally == Counter(expected)
    assert len(trajectory) == len(fixes) - sum(expected.values())


def test_a_recording_that_starts_again_is_read_once(tmp_path: Path) -> None:
    fixes, _ = STREAMS['sound']
    again = fixes + [Fix(f.arrival_ns + 30 * 10**9, f.stamp_ns, f.latitude_deg, f.longitude_deg) for f in fixes]
    once = read_mulran_gps(exact_table(tmp_path / 'once.csv', fixes))
    twice = read_mulran_gps(exact_table(tmp_path / 'twice.csv', again))
    assert poses_of(twice) == poses_of(once)
    mapped, _ = live(again, 0)
    assert mapped.keys() == poses_of(once).keys()


@pytest.mark.parametrize(('restart_after_s', 'count'), [(1.0, 23), (10.0, 12)])
def test_scans_that_go_back_are_counted_by_what_a_restart_of_the_radar_is(restart_after_s: float, count: int) -> None:
    stamps_ns = [k * 250_000_000 for k in range(1, 13)] + [125_000_000 + k * 250_000_000 for k in range(1, 12)]
    scans = [(k * 250_000_000, stamp) for k, stamp in enumerate(stamps_ns)]
    positions = [(0, k * 100_000_000) for k in range(40)]
    assert count_positioned(scans, positions, PositionConfig(), restart_after_s) == count
