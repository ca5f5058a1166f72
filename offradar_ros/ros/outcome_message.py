"""Match ↔ PointCloud2 and PoseWithCovarianceStamped; Rejection ↔ DiagnosticArray."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2

from offradar_ros.bounded_input import parse_json
from offradar_ros.config import QueryConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.place_check import MAX_PLACE_ID
from offradar_ros.messages import stamp_ns
from offradar_ros.retrieval.vehicle_pose import VehiclePose, vehicle_pose
from offradar_ros.ros.clouds import from_cloud, to_cloud
from offradar_ros.ros.place_message import MAP_FRAME
from offradar_ros.ros.stamps import header
from offradar_ros.types import Alignment, Candidate, Evidence, Match, Pose, Reason, Rejection

MAX_CANDIDATES = 1000
"""Most places of an answer: the largest `query.top_k`."""

MAX_CANDIDATES_BYTES = 2**20
"""Longest JSON of the places of a rejection: each takes some 200 bytes."""

_PLANAR = (0, 1, 5)
"""Rows of x, y and yaw in a covariance of ROS."""

_UPPER = np.triu_indices(3)

MAX_VALUES = 64
"""Most key-value pairs in a rejection."""

CANDIDATE = np.dtype(
    [
        ('x', '<f4'),
        ('y', '<f4'),
        ('z', '<f4'),
        ('distance', '<f4'),
        ('uncertainty', '<f4'),
        ('place_id', '<u4'),
        ('yaw', '<f4'),
        ('query_uncertainty', '<f8'),
        ('threshold', '<f8'),
        ('p_right', '<f8'),
        ('distance_apart', '<f8'),
        ('place_distance_apart', '<f8'),
        ('score', '<f8'),
        ('relative_pose', '<f8', (3,)),
        ('relative_covariance', '<f8', (6,)),
    ]
)


def match_message(match: Match) -> PointCloud2:
    """The top k places, the best first; `uncertainty` is the place's, `query_uncertainty` the scan's.

    `p_right` and both distances are of the first place, in each point. `score`, `relative_pose` (x, y, yaw) and
    `relative_covariance` (its upper triangle, row by row) are the alignment with the scan of the place, NaN for none.
    """
    points = np.empty(len(match.candidates), CANDIDATE)
    for point, candidate in zip(points, match.candidates, strict=True):
        pose = candidate.pose
        point['x'], point['y'], point['z'], point['yaw'] = pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad
        point['distance'], point['uncertainty'] = candidate.distance, candidate.uncertainty
        point['place_id'] = candidate.place_id
        score, relative_pose, relative_covariance = _alignment_values(candidate.alignment)
        point['score'] = score
        point['relative_pose'], point['relative_covariance'] = relative_pose, relative_covariance
    points['query_uncertainty'], points['threshold'] = match.uncertainty, match.threshold
    points['p_right'] = match.p_right
    points['distance_apart'], points['place_distance_apart'] = _distances_apart(match.evidence)
    return to_cloud(points, header(match.stamp_ns, MAP_FRAME))


def match_record(message: PointCloud2, topic: str) -> Match:
    """The match in a message; RefusedInput if it is not one, or a place of it has a value that is not finite."""
    stamp = stamp_ns(message.header.stamp)
    points = from_cloud(message, CANDIDATE, topic)
    if not 0 < len(points) <= MAX_CANDIDATES:
        raise RefusedInput(
            'wrong_size',
            f'{topic}: {len(points)} places in a match: expected 1 to {MAX_CANDIDATES}',
        )
    try:
        candidates = tuple(_candidate(_named(point)) for point in points)
    except ValueError as error:
        raise RefusedInput('invalid_place', f'{topic}: a place of a match has {error}') from None
    first = points[0]
    uncertainty = float(first['query_uncertainty'])
    apart = float(first['distance_apart']), float(first['place_distance_apart'])
    return Match(
        stamp,
        uncertainty,
        float(first['threshold']),
        candidates,
        float(first['p_right']),
        _evidence(candidates, uncertainty, apart),
    )


def _distances_apart(evidence: Evidence | None) -> tuple[float, float]:
    return (evidence.distance_apart, evidence.place_distance_apart) if evidence else (math.nan, math.nan)


def _evidence(
    candidates: tuple[Candidate, ...], uncertainty: float, distances_apart: tuple[float, float]
) -> Evidence | None:
    if math.isnan(distances_apart[0]) or not candidates:
        return None
    return Evidence(candidates[0].distance, *distances_apart, uncertainty, candidates[0].uncertainty)


def match_pose_message(match: Match, config: QueryConfig) -> PoseWithCovarianceStamped:
    """The pose of the vehicle at the first place (`vehicle_pose`), for robot_localization or AMCL.

    An unknown heading is given as that of the place, or 0.
    """
    place = match.candidates[0]
    return vehicle_pose_message(match.stamp_ns, vehicle_pose(place, config), config, place.pose.yaw_rad)


def vehicle_pose_message(
    stamp_ns: int, found: VehiclePose, config: QueryConfig, otherwise_rad: float = 0.0
) -> PoseWithCovarianceStamped:
    """A pose of the vehicle; `otherwise_rad` is given where its heading is unknown, and 0 where that is NaN.

    Roll and pitch have a variance of π². The height is that of the place.
    """
    guesses = (found.pose.yaw_rad, otherwise_rad, 0.0)
    yaw_rad = next(yaw_rad for yaw_rad in guesses if not math.isnan(yaw_rad))
    message = PoseWithCovarianceStamped(header=header(stamp_ns, MAP_FRAME))
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = found.pose.x_m, found.pose.y_m, found.pose.z_m
    orientation.z, orientation.w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    covariance = np.diag([0.0, 0.0, config.position_sigma_m**2, np.pi**2, np.pi**2, 0.0])
    covariance[np.ix_(_PLANAR, _PLANAR)] = found.covariance
    message.pose.covariance = covariance.reshape(-1)
    return message


def rejection_message(rejection: Rejection) -> DiagnosticArray:
    """Reason, U, threshold, probability, evidence and, as JSON, the candidates that would have been returned."""
    candidates = [
        {
            'place_id': c.place_id,
            'distance': c.distance,
            'uncertainty': c.uncertainty,
            'x': c.pose.x_m,
            'y': c.pose.y_m,
            'z': c.pose.z_m,
            'yaw': None if math.isnan(c.pose.yaw_rad) else c.pose.yaw_rad,
            'alignment': None if c.alignment is None else _alignment_values(c.alignment),
        }
        for c in rejection.candidates
    ]
    apart, place_apart = _distances_apart(rejection.evidence)
    values = {
        'reason': rejection.reason.value,
        'uncertainty': repr(rejection.uncertainty),
        'threshold': repr(rejection.threshold),
        'p_right': repr(rejection.p_right),
        'distance_apart': repr(apart),
        'place_distance_apart': repr(place_apart),
        'candidates': json.dumps(candidates),
    }
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN,
        name='query: rejection',
        message=f'{rejection.reason.value}: {rejection.detail}',
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    return DiagnosticArray(header=header(rejection.stamp_ns, MAP_FRAME), status=[status])


def rejection_record(message: DiagnosticArray, topic: str) -> Rejection:
    """The rejection in a message; RefusedInput('wrong_fields') if it is not one."""
    stamp = stamp_ns(message.header.stamp)
    try:
        status = message.status[0]
        values = {item.key: item.value for item in status.values[:MAX_VALUES]}
        listed = parse_json(values['candidates'], MAX_CANDIDATES_BYTES)
        if not isinstance(listed, list) or len(listed) > MAX_CANDIDATES:
            raise ValueError(f'expected a list of at most {MAX_CANDIDATES} candidates')
        candidates = tuple(_candidate(c | {'yaw': math.nan if c['yaw'] is None else c['yaw']}) for c in listed)
        uncertainty = float(values['uncertainty'])
        apart = float(values['distance_apart']), float(values['place_distance_apart'])
        return Rejection(
            stamp,
            Reason(values['reason']),
            uncertainty,
            float(values['threshold']),
            candidates,
            status.message.partition(': ')[2],
            float(values['p_right']),
            _evidence(candidates, uncertainty, apart),
        )
    except (IndexError, KeyError, ValueError, TypeError) as error:
        raise RefusedInput(
            'wrong_fields', f'{topic}: expected reason, uncertainty, threshold and candidates'
        ) from error


def _candidate(values: Mapping[str, Any]) -> Candidate:
    """A candidate of named values; ValueError for one that is not a number, or not finite, but for an unknown yaw."""
    place_id = values['place_id']
    if type(place_id) is not int or not 0 <= place_id <= MAX_PLACE_ID:
        raise ValueError('an id that is none')
    finite = [_number(values[name]) for name in ('distance', 'uncertainty', 'x', 'y', 'z')]
    yaw_rad = _number(values['yaw'])
    if not all(map(math.isfinite, finite)) or math.isinf(yaw_rad):
        raise ValueError('a value that is not finite')
    distance, uncertainty, x_m, y_m, z_m = finite
    return Candidate(place_id, distance, uncertainty, Pose(x_m, y_m, z_m, yaw_rad), _alignment(values['alignment']))


def _named(point: np.void) -> dict[str, Any]:
    """The values of a point of a match by their names."""
    names = CANDIDATE.names or ()
    values = dict(zip(names, point.tolist(), strict=True))
    parts = [values.pop(name) for name in names[-3:]]
    return values | {'alignment': None if math.isnan(parts[0]) else [parts[0], *(part.tolist() for part in parts[1:])]}


def _alignment_values(found: Alignment | None) -> tuple[float, list[float], list[float]]:
    """Score, pose, and the upper triangle of the covariance."""
    if found is None:
        return math.nan, [math.nan] * 3, [math.nan] * 6
    return found.score, found.pose.tolist(), found.covariance[_UPPER].tolist()


def _alignment(values: Any) -> Alignment | None:
    """An alignment of these values; ValueError for one that is not finite, or has a covariance that is none."""
    if values is None:
        return None
    score, pose, upper = values
    if len(pose) != 3 or len(upper) != 6:
        raise ValueError('an alignment that is none')
    numbers = [_number(value) for value in (score, *pose, *upper)]
    covariance = np.empty((3, 3))
    covariance[_UPPER] = covariance.T[_UPPER] = numbers[4:]
    if not all(map(math.isfinite, numbers)) or (np.diag(covariance) < 0.0).any():
        raise ValueError('an alignment that is none')
    return Alignment(np.array(numbers[1:4]), covariance, numbers[0])


def _number(value: Any) -> float:
    # A whole number of JSON may be too large for a float; a bool is a number too.
    if type(value) not in {int, float} or (type(value) is int and value.bit_length() > 1000):
        raise ValueError('a value that is not a number')
    return float(value)
