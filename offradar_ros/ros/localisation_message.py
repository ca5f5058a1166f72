"""Localisation ↔ DiagnosticArray, and its position as PoseWithCovarianceStamped."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped

from offradar_ros.errors import RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.ros.place_message import MAP_FRAME
from offradar_ros.ros.stamps import header
from offradar_ros.types import Localisation, LocalisationState

MAX_VALUES = 64
"""Most key-value pairs in a localisation."""


def localisation_message(found: Localisation) -> DiagnosticArray:
    """State and probabilities, the best place, and the position with its covariance; OK where the state is on_map."""
    (xx, xy), (_, yy) = found.covariance_m2.tolist()
    x_m, y_m = found.position_m.tolist()
    values = {
        'state': found.state.value,
        'p_on_map': repr(found.p_on_map),
        'place_id': '' if found.place_id is None else str(found.place_id),
        'p_here': repr(found.p_here),
        'x': repr(x_m),
        'y': repr(y_m),
        'covariance_xx': repr(xx),
        'covariance_xy': repr(xy),
        'covariance_yy': repr(yy),
    }
    on_map = found.state is LocalisationState.ON_MAP
    status = DiagnosticStatus(
        level=DiagnosticStatus.OK if on_map else DiagnosticStatus.WARN,
        name='query: localisation',
        message=f'{found.state.value}: on the map with probability {found.p_on_map:.4f}',
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    return DiagnosticArray(header=header(found.stamp_ns, MAP_FRAME), status=[status])


def localisation_record(message: DiagnosticArray, topic: str) -> Localisation:
    """The localisation in a message; RefusedInput('wrong_fields') if it is not one."""
    stamp = stamp_ns(message.header.stamp)
    try:
        values = {item.key: item.value for item in message.status[0].values[:MAX_VALUES]}
        xx, xy, yy = (float(values[f'covariance_{name}']) for name in ('xx', 'xy', 'yy'))
        return Localisation(
            stamp,
            LocalisationState(values['state']),
            float(values['p_on_map']),
            int(values['place_id']) if values['place_id'] else None,
            float(values['p_here']),
            np.array([float(values['x']), float(values['y'])]),
            np.array([[xx, xy], [xy, yy]]),
        )
    except (IndexError, KeyError, ValueError) as error:
        raise RefusedInput('wrong_fields', f'{topic}: expected state, probabilities and position') from error


def localisation_pose_message(found: Localisation) -> PoseWithCovarianceStamped:
    """The position, of a localisation with a place; heading and height are unknown (variances π² and 10⁶ m²)."""
    message = PoseWithCovarianceStamped(header=header(found.stamp_ns, MAP_FRAME))
    message.pose.pose.position.x, message.pose.pose.position.y = found.position_m.tolist()
    message.pose.pose.orientation.w = 1.0
    covariance = np.diag([0.0, 0.0, 1e6, *[np.pi**2] * 3])
    covariance[:2, :2] = found.covariance_m2
    message.pose.covariance = covariance.reshape(-1)
    return message
