"""What our nodes said in a bag is told from what others said under the same names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from recorded_topics import DIAGNOSTICS_TYPE, Recorded, grid, record, report, scans
from sensor_msgs.msg import PointCloud2

from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.ros.clouds import to_cloud
from offradar_ros.ros.embedding_message import embedding_message
from offradar_ros.ros.outcome_message import match_message
from offradar_ros.ros.place_message import (
    PlaceRows,
    descriptors_message,
    map_message,
    read_the_file_message,
)
from offradar_ros.ros.recorded_outputs import is_output, is_own_report
from offradar_ros.ros.signatures_message import signatures_message, wanted_message
from offradar_ros.ros.stamps import header
from offradar_ros.types import Candidate, Embedding, Match, PlaceTable, Pose, ScanKey

CLOUD = 'sensor_msgs/msg/PointCloud2'
STAMP_NS = 1_600_000_000_000_000_000
NOTHING = np.empty(0, np.float32)
PLACES = PlaceTable.from_places([], 8)
OURS = {
    '/embedding': embedding_message(Embedding(STAMP_NS, np.ones(8, np.float32), np.ones(8, np.float32), 'ab' * 32), ''),
    '/car/embedding': embedding_message(Embedding(STAMP_NS, NOTHING, NOTHING, 'ab' * 32), ''),
    '/map': map_message(PLACES, STAMP_NS),
    '/map/descriptors': descriptors_message(PlaceRows(PLACES, 'ab' * 32, committed=True), STAMP_NS),
    '/big/map/descriptors': read_the_file_message(STAMP_NS),
    '/renamed/places': map_message(PLACES, STAMP_NS),
    '/map/updates': descriptors_message(PlaceRows(PLACES, 'ab' * 32, committed=False), STAMP_NS),
    '/map/signatures': signatures_message({ScanKey(1, 5): b''}, STAMP_NS),
    '/map/signatures_wanted': wanted_message([ScanKey(1, 5)], STAMP_NS),
    '/matches': match_message(Match(STAMP_NS, 1.0, 1.5, (Candidate(1, 0.1, 1.0, Pose(0.0, 0.0, 0.0, 0.0)),), 0.9)),
}


def cloud(topic: str, message: PointCloud2) -> Recorded:
    return Recorded(STAMP_NS, topic, CLOUD, serialize_message(message))


@pytest.fixture
def outputs(tmp_path: Path) -> Callable[..., dict[str, bool]]:
    """Whether each topic of some messages holds what our nodes said."""

    def told(*rows: Recorded, **options: Any) -> dict[str, bool]:
        with Bag(record(tmp_path / 'bag', rows, **options)) as bag:
            return {topic: is_output(bag, topic) for topic in bag.topics}

    return told


def test_what_our_nodes_publish_is_theirs(outputs: Callable[..., dict[str, bool]]) -> None:
    assert outputs(*(cloud(topic, message) for topic, message in OURS.items())) == dict.fromkeys(OURS, True)


def test_the_same_names_of_others_are_theirs(outputs: Callable[..., dict[str, bool]]) -> None:
    lidar = to_cloud(
        np.zeros(3, np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4')])), header(1, '')
    )
    foreign = [cloud(topic, lidar) for topic in ('/lidar/map', '/lidar/embedding', '/lidar/matches')]
    grids = [grid(STAMP_NS, topic) for topic in ('/map', '/slam/map', '/map/updates', '/embedding', '/clock')]
    expected = dict.fromkeys([row.topic for row in (*foreign, *grids)], False)
    assert outputs(*foreign, *grids) == expected


def test_what_concerns_the_recorded_processes_is_left_out(outputs: Callable[..., dict[str, bool]]) -> None:
    system = [('/clock', 'rosgraph_msgs/msg/Clock'), ('/rosout', 'rcl_interfaces/msg/Log')]
    system += [('/parameter_events', 'rcl_interfaces/msg/ParameterEvent')]
    answers = [('/rejections', DIAGNOSTICS_TYPE), ('/car/localisation', DIAGNOSTICS_TYPE), ('/embedding', CLOUD)]
    others = [('/diagnostics', DIAGNOSTICS_TYPE), ('/tf', 'tf2_msgs/msg/TFMessage')]
    assert outputs(empty=[*system, *answers, *others]) == {
        **dict.fromkeys([name for name, _ in (*system, *answers)], True),
        **dict.fromkeys([name for name, _ in others], False),
    }


def test_diagnostics_are_told_by_the_names_of_their_statuses(street: Callable[..., Any], tmp_path: Path) -> None:
    told = {
        ('encoder: offradar_ros',): True,
        ('car/encoder: offradar_ros', 'car/query: offradar_ros'): True,
        ('navtech: temperature',): False,
        ('encoder: offradar_ros', 'navtech: temperature'): False,
        (): False,
    }
    rows = [report(STAMP_NS + index, *names) for index, names in enumerate(told)]
    with Bag(record(tmp_path / 'bag', rows, scans(street(count=1)))) as bag:
        assert [is_own_report(bag, raw) for raw in bag.messages(['/diagnostics'])] == list(told.values())
