"""What our nodes themselves published when a bag was recorded, told by name, type and content.

Other packages use the same names: nearly every robot has a ``/map`` and ``/diagnostics``.
"""

from __future__ import annotations

from typing import Any

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.reader import Bag, RawMessage

STATUS_NAME = ': offradar_ros'
"""End of the name of each status that our nodes report on /diagnostics."""

DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
_CLOUD = 'sensor_msgs/msg/PointCloud2'
_POSE = 'geometry_msgs/msg/PoseWithCovarianceStamped'
_CLOUDS = (
    '/embedding',
    '/map',
    '/map/descriptors',
    '/map/updates',
    '/map/signatures',
    '/map/signatures_wanted',
    '/matches',
)
_FIELDS = (
    {'mean', 'variance', 'model'},
    {'place_id', 'intensity'},
    {'place_id', 'embedding'},
    {'place_id', 'query_uncertainty'},
    {'session_id', 'stamp_sec', 'stamp_nanosec'},
)
"""Fields by which our clouds are told from others, also under a name that they were remapped to."""
_READ_THE_FILE = {'read_the_file'}
_TYPES = {
    '/embedding/model': 'diagnostic_msgs/msg/DiagnosticStatus',
    '/localisation': DIAGNOSTICS,
    '/localisation_pose': _POSE,
    '/map_server/handled': 'std_msgs/msg/Header',
    '/match_pose': _POSE,
    '/p_on_map': 'std_msgs/msg/Float64',
    '/rejections': DIAGNOSTICS,
}
_SYSTEM = {
    '/clock': 'rosgraph_msgs/msg/Clock',
    '/parameter_events': 'rcl_interfaces/msg/ParameterEvent',
    '/rosout': 'rcl_interfaces/msg/Log',
}
"""Of the processes that were recorded: played again, they would tell others a wrong time or wrong parameters."""


def is_output(bag: Bag, topic: str) -> bool:
    """Whether a topic holds what our nodes answered, or what only concerns the processes that were recorded."""
    msgtype = bag.topics[topic]
    if any(topic.endswith(name) and msgtype == kind for name, kind in (_TYPES | _SYSTEM).items()):
        return True
    if msgtype != _CLOUD:
        return False
    try:
        first = next(bag.messages([topic]), None)
        # The first message shows it: each has its fields, also if it has no points.
        fields = None if first is None else {field.name for field in bag.decode(first).fields}
    except DataError:
        fields = None
    if fields is None:
        return topic.endswith(_CLOUDS)
    return fields == _READ_THE_FILE or any(known <= fields for known in _FIELDS)


def is_own_report(bag: Bag, message: RawMessage) -> bool:
    """Whether every status in a message of /diagnostics is of one of our nodes."""
    try:
        statuses: list[Any] = list(bag.decode(message).status)
    except DataError:
        return False
    return bool(statuses) and all(status.name.endswith(STATUS_NAME) for status in statuses)
