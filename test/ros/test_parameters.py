"""Every parameter of the nodes is a field of the configuration, described and bounded."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from offradar_ros.config import Config, parameters
from offradar_ros.errors import ConfigError
from offradar_ros.ros.parameters import changed, declare, descriptor, validate

STAGES = [field.name for field in dataclasses.fields(Config)]


@pytest.fixture
def context(domain_id: int) -> Iterator[rclpy.context.Context]:
    context = rclpy.context.Context()
    rclpy.init(context=context, domain_id=domain_id)
    yield context
    rclpy.shutdown(context=context)


def given(overrides: dict[str, object]) -> list[Parameter]:
    return [Parameter(name.replace('__', '.'), value=value) for name, value in overrides.items()]


def declared(context: rclpy.context.Context, **overrides: object) -> tuple[Node, Config]:
    node = Node('test', context=context, parameter_overrides=given(overrides), enable_rosout=False)
    return node, declare(node, Config(), STAGES, given(overrides))


def test_every_parameter_is_declared_with_its_default_and_description(context: rclpy.context.Context) -> None:
    declaring, config = declared(context)
    assert config == Config()
    for leaf in parameters(Config()):
        assert declaring.get_parameter(leaf.name).value == leaf.value
        described = declaring.describe_parameter(leaf.name)
        assert leaf.bounds.description in described.description
        assert described.read_only == leaf.bounds.read_only


def test_overrides_are_taken(context: rclpy.context.Context) -> None:
    _, config = declared(context, map__match_distance_m=12.5, query__level=3)
    assert (config.map.match_distance_m, config.query.level) == (12.5, 3)


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('map__match_distance_m', -1.0, r'map\.match_distance_m: expected at least 0\.01 m, got -1'),
        ('query__top_k', 0, r'query\.top_k: expected at least 1, got 0'),
        ('map__replace', 'best', r'map\.replace: expected one of nearest, worst, all'),
        ('query__level', 'high', r'parameter query\.level'),
        ('query__level', 11, r'query\.level: expected at most query\.levels = 10, got 11'),
    ],
)
def test_an_invalid_override_is_one_line(
    context: rclpy.context.Context, name: str, value: object, expected: str
) -> None:
    with pytest.raises(ConfigError, match=expected) as error:
        declared(context, **{name: value})
    assert '\n' not in str(error.value)


def test_arguments_are_taken_and_checked_like_overrides(context: rclpy.context.Context) -> None:
    def node(*arguments: str) -> Node:
        return Node('test', context=context, cli_args=['--ros-args', *arguments], enable_rosout=False)

    assert declare(node('-p', 'query.level:=3'), Config(), STAGES).query.level == 3
    with pytest.raises(ConfigError, match=r'query\.top_k: expected at least 1, got 0'):
        declare(node('-p', 'query.top_k:=0'), Config(), STAGES)
    with pytest.raises(ConfigError, match=r'query\.topk is unknown: did you mean query\.top_k\?'):
        declare(node('-p', 'query.topk:=3'), Config(), STAGES)


def test_changes_are_validated_before_they_apply() -> None:
    good, bad = [Parameter('query.level', value=4)], [Parameter('query.delta', value=-1.0)]
    assert validate(Config(), good).successful
    refused = validate(Config(), bad)
    assert not refused.successful
    assert 'query.delta: expected at least 0' in refused.reason
    assert changed(Config(), good).query.level == 4
    assert changed(Config(), [Parameter('use_sim_time', value=True)]) == Config()


def test_ranges_are_those_of_the_bounds() -> None:
    for leaf in parameters(Config()):
        described = descriptor(leaf.bounds, leaf.value)
        if leaf.bounds.minimum is None or leaf.bounds.maximum is None:
            continue
        (span,) = described.floating_point_range or described.integer_range
        assert (span.from_value, span.to_value) == (leaf.bounds.minimum, leaf.bounds.maximum)
