"""The start of ROS in a process: what prevents it is one line that says what to do."""

from __future__ import annotations

import contextlib
import os
import re
import signal
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.utilities import remove_ros_args

from offradar_ros.errors import OffradarError
from offradar_ros.ros.parameter_files import check_parameter_files

SWITCHES = ('RCUTILS_COLORIZED_OUTPUT', 'RCUTILS_LOGGING_USE_STDOUT', 'RCUTILS_LOGGING_BUFFERED_STREAM')
MAX_DOMAIN = 232
"""Above this, the ports of a domain would not be ports."""


def initialise(args: Sequence[str] | None, **options: Any) -> None:
    """As rclpy.init, but raises OffradarError.

    `args` are those of the process, its name first; None or none of them is no argument at all.
    """
    argv = list(args or ())
    _check_switches(os.environ)
    if options.get('domain_id') is None:
        _check_domain(os.environ.get('ROS_DOMAIN_ID', ''))
    try:
        rclpy.init(args=argv, **options)
    except Exception as error:
        raise OffradarError(_explain(error)) from error


def end_on_hang_up() -> None:
    """Take the end of the terminal as SIGTERM, after which a node ends in order; as nohup has it, where that is used.

    To be called in the main thread. Without it, a connection that breaks ends the process at once, and its session is
    cut off.
    """
    if signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))


def own_arguments(argv: Sequence[str]) -> list[str]:
    """The arguments that are not for ROS, without the name of the program; OffradarError for bad ones for ROS.

    To be called before `initialise`: ROS would wait for a parameter file that is a FIFO.
    """
    _check_switches(os.environ)
    check_parameter_files(argv)
    try:
        return list(remove_ros_args(list(argv))[1:])
    except Exception as error:
        raise OffradarError(_explain(error)) from error


@contextlib.contextmanager
def refusals_of_ros() -> Iterator[None]:
    """Raises OffradarError for a node that ROS does not create: a bad name, parameter or quality of service."""
    try:
        yield
    except (
        rclpy_implementation.RCLError,
        NameValidationException,
        ParameterException,
        InvalidQosOverridesError,
    ) as error:
        # After an interrupt any call fails.
        if not rclpy.ok():
            raise
        raise OffradarError(_explain(error)) from error
    except RuntimeError as error:
        if 'QoS override' not in str(error):
            raise
        raise OffradarError(f'parameters qos_overrides: {error}') from error


def _check_switches(environment: Mapping[str, str]) -> None:
    """OffradarError for a switch of ROS' log that is none: ROS would print an error for each line that it logs."""
    for name in SWITCHES:
        if (text := environment.get(name, '')) not in ('', '0', '1'):
            raise OffradarError(f'{name}={text}: expected 0 or 1')


def _check_domain(text: str) -> None:
    if text and not (text.isdecimal() and int(text) <= MAX_DOMAIN):
        raise OffradarError(f'ROS_DOMAIN_ID={text}: expected a whole number from 0 to {MAX_DOMAIN}')


def _explain(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines()] or [type(error).__name__]
    # A name that is refused is on the second line.
    text = ' '.join(lines[:2]) if lines[0].endswith(':') else lines[0]
    # Where in the C sources it was found says nothing to a user.
    text = re.sub(r', at \S+:\d+', '', text).removeprefix('failed to initialize rcl: ')
    if 'initialize logging' in text:
        return (
            f'{text}: ROS writes its log there: set ROS_LOG_DIR to a folder that can be written '
            '(export ROS_LOG_DIR=/tmp/ros_log)'
        )
    if 'error not set' in text and os.environ.get('ROS_SECURITY_ENABLE', '').lower() == 'true':
        return (
            'ROS_SECURITY_ENABLE is true, and no keys are found: set ROS_SECURITY_KEYSTORE to the keystore, and name '
            'the enclave (--ros-args --enclave /NAME)'
        )
    if 'Failed to create' in text:
        text += ': check the qos_overrides parameters'
    return f'ROS: {text}'
