"""ROS parameters out of the configuration dataclasses: same names, descriptions, units and bounds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from offradar_ros.config import Bounds, Config, parameters, replace_values
from offradar_ros.entry_point import special_file
from offradar_ros.errors import ConfigError

MAX_NAMED = 5
"""Most names that a warning shows."""
_OF_ROS = {'autostart', 'qos_overrides', 'start_type_description_service', 'use_sim_time'}


def descriptor(bounds: Bounds, value: bool | int | float | str) -> ParameterDescriptor:
    """What `ros2 param describe` shows."""
    unit = f' [{bounds.unit}]' if bounds.unit else ''
    described = ParameterDescriptor(description=bounds.description + unit, read_only=bounds.read_only)
    # ROS takes 1 for an integer and would refuse it where 1.0 is meant; `declare` and `validate` check the type.
    described.dynamic_typing = isinstance(value, float)
    if bounds.choices:
        described.additional_constraints = 'one of ' + ', '.join(bounds.choices)
    if bounds.minimum is not None and bounds.maximum is not None:
        if isinstance(value, float):
            described.floating_point_range = [
                FloatingPointRange(from_value=float(bounds.minimum), to_value=float(bounds.maximum), step=0.0)
            ]
        else:
            described.integer_range = [
                IntegerRange(from_value=int(bounds.minimum), to_value=int(bounds.maximum), step=1)
            ]
    return described


def declare(node: Node, config: Config, groups: Sequence[str], overrides: Sequence[RosParameter] = ()) -> Config:
    """Declare the parameters of some groups, and return the configuration that they give.

    Args:
        node: where they are declared.
        config: the defaults.
        groups: names of the parts of the configuration that the node takes, such as ``query``.
        overrides: those that the node was constructed with (``parameter_overrides``).

    Raises:
        ConfigError: a value is invalid or a name is unknown.
    """
    given = _given(node, overrides)
    _refuse_unknown(given, config)
    values: dict[str, Any] = {}
    for leaf in parameters(config):
        if leaf.name.split('.')[0] in groups:
            try:
                values[leaf.name] = node.declare_parameter(
                    leaf.name, leaf.value, descriptor(leaf.bounds, leaf.value)
                ).value
            except ParameterException as error:
                problem = leaf.bounds.problem(given[leaf.name]) if leaf.name in given else None
                reason = problem or str(error).splitlines()[0]
                raise ConfigError(f'parameter {leaf.name}: {reason}') from error
    return replace_values(config, values)


def require_files(config: Config) -> None:
    """ConfigError for a path that is a FIFO or a device: a node would wait for it for ever."""
    paths = {
        'encoder.weights': config.encoder.weights,
        'map.path': config.map.path,
        'query.map_path': config.query.map_path,
    }
    for name, path in paths.items():
        if path and (kind := special_file(path)):
            raise ConfigError(f'parameter {name}: {path} is {kind}: expected a file')


def names_given(node: Node, overrides: Sequence[RosParameter] = ()) -> set[str]:
    """Names of the parameters that files, arguments or the constructor (`overrides`) set."""
    return set(_given(node, overrides))


def not_ours(names: Iterable[str]) -> list[str]:
    """One line for names that no node of ours has, which may be misspelt; files for several packages have such."""
    groups = {leaf.name.split('.')[0] for leaf in parameters(Config())}
    others = sorted(name for name in names if name.split('.')[0] not in groups | _OF_ROS)
    if not others:
        return []
    shown = ', '.join(others[:MAX_NAMED]) + (f' and {len(others) - MAX_NAMED} more' if len(others) > MAX_NAMED else '')
    return [f'parameters that no node of offradar_ros has, and that are not used: {shown}']


def _given(node: Node, overrides: Sequence[RosParameter]) -> dict[str, Any]:
    """Values by name: of parameter files and arguments, and those that the node was constructed with, which win."""
    with node.handle:
        arguments: dict[str, RosParameter] = node.handle.get_parameters(RosParameter)
    return {name: parameter.value for name, parameter in arguments.items()} | {p.name: p.value for p in overrides}


def _refuse_unknown(given: Iterable[str], config: Config) -> None:
    """ConfigError for a misspelt name, which would leave the default in force. Names of other groups are not ours."""
    known = [leaf.name for leaf in parameters(config)]
    ours = {name.split('.')[0] for name in known}
    for name in given:
        if name.split('.')[0] in ours and '.' in name and name not in known:
            replace_values(config, {name: None})


def changed(config: Config, updates: Sequence[RosParameter]) -> Config:
    """The configuration after `updates`; those of other groups and of rclpy itself are ignored."""
    known = {leaf.name for leaf in parameters(config)}
    return replace_values(config, {p.name: p.value for p in updates if p.name in known})


def validate(config: Config, updates: Sequence[RosParameter]) -> SetParametersResult:
    """Whether `updates` may be set, and if not, why."""
    try:
        changed(config, updates)
    except ConfigError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)
