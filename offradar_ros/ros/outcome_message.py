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
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.place_check import MAX_PLACE_ID
from offradar_ros.messages import stamp_ns
from offradar_ros.ros.clouds import from_cloud, to_cloud
from offradar_ros.ros.place_message import MAP_FRAME
from offradar_ros.ros.stamps import header
from offradar_ros.types import Candidate, Evidence, Match, Pose, Reason, Rejection

MAX_CANDIDATES = 1000
"""Most places of an answer: the largest `query.top_k`."""

MAX_CANDIDATES_BYTES = 2**20
"""Longest JSON of the places of a rejection: each takes some 200 bytes."""

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
    ]
)


def match_message(match: Match) -> PointCloud2:
    """The top k places, nearest first; `uncertainty` is the place's, `query_uncertainty` the scan's.

    `p_right` and both distances are of the first place, in each point.
    """
    points = np.empty(len(match.candidates), CANDIDATE)
    for point, candidate in zip(points, match.candidates, strict=True):
        pose = candidate.pose
        point['x'], point['y'], point['z'], point['yaw'] = pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad
        point['distance'], point['uncertainty'] = candidate.distance, candidate.uncertainty
        point['place_id'] = candidate.place_id
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
        candidates = tuple(_candidate(dict(zip(CANDIDATE.names or (), p.tolist(), strict=True))) for p in points)
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


def match_pose_message(match: Match, position_sigma_m: float) -> PoseWithCovarianceStamped:
    """The best place as a pose for robot_localization or AMCL.

    The descriptor does not change when the vehicle turns on the spot, so the heading is unknown: it is given as the
    mapped scan's, with a variance of π².
    """
    pose = match.candidates[0].pose
    yaw_rad = 0.0 if math.isnan(pose.yaw_rad) else pose.yaw_rad
    message = PoseWithCovarianceStamped(header=header(match.stamp_ns, MAP_FRAME))
    message.pose.pose.position.x, message.pose.pose.position.y = pose.x_m, pose.y_m
    message.pose.pose.position.z = pose.z_m
    message.pose.pose.orientation.z = math.sin(yaw_rad / 2)
    message.pose.pose.orientation.w = math.cos(yaw_rad / 2)
    covariance = np.zeros((6, 6))
    covariance[range(3), range(3)] = position_sigma_m**2
    covariance[range(3, 6), range(3, 6)] = np.pi**2
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
    return Candidate(place_id, distance, uncertainty, Pose(x_m, y_m, z_m, yaw_rad))


def _number(value: Any) -> float:
    # A whole number of JSON may be too large for a float; a bool is a number too.
    if type(value) not in {int, float} or (type(value) is int and value.bit_length() > 1000):
        raise ValueError('a value that is not a number')
    return float(value)
