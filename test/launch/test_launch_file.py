"""The launch file ends with one line where it would start nodes that nobody meant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from launch_stand_in import launched, of_kind


@pytest.fixture
def check() -> Callable[[Path], None]:
    """The check of `params:=PATH`, which comes before the first node."""
    actions = launched()
    (check,) = of_kind('OpaqueFunction')
    kinds = [type(action).__name__ for action in actions]
    assert kinds.index('OpaqueFunction') < kinds.index('Node')
    return lambda path: check.options['function']({'params': str(path)})


def test_a_parameter_file_that_is_missing_ends_the_launch(check: Callable[[Path], None], tmp_path: Path) -> None:
    for absent in (tmp_path / 'car.yaml', tmp_path):
        with pytest.raises(RuntimeError, match=r'^params:=.*: no such file: expected a parameter file') as refused:
            check(absent)
        assert len(str(refused.value).splitlines()) == 1


def test_a_parameter_file_is_accepted(check: Callable[[Path], None], tmp_path: Path) -> None:
    (tmp_path / 'car.yaml').write_text('/**:\n  ros__parameters: {}\n')
    check(tmp_path / 'car.yaml')


def test_nodes_start_again_only_if_that_is_asked_for() -> None:
    declared: dict[str, Any] = {each.arguments[0]: each.options for each in of_kind('DeclareLaunchArgument')}
    assert declared['respawn']['default_value'] == 'false'
    nodes = of_kind('Node')
    assert [node.options['respawn'].arguments for node in nodes] == [('respawn',)] * 3
    assert all(node.options['respawn_delay'] > 0 for node in nodes)


def test_every_argument_says_what_it_is() -> None:
    assert all(each.options['description'] for each in of_kind('DeclareLaunchArgument'))
