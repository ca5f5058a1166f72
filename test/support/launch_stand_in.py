"""The launch file without ROS 2 launch, which need not be installed: its actions keep their arguments."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

LAUNCH_FILE = Path(__file__).resolve().parents[2] / 'launch' / 'offradar.launch.py'


class Recorded:
    """Stands for every class of `launch`: it keeps its arguments."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.arguments, self.options = arguments, options

    def perform(self, context: Mapping[str, str]) -> str:
        """As a LaunchConfiguration: the value of an argument, which `context` maps by name."""
        return context[self.arguments[0]]


@contextmanager
def _without_launch() -> Iterator[None]:
    made = {
        'launch': ('LaunchContext', 'LaunchDescription'),
        'launch.actions': ('DeclareLaunchArgument', 'OpaqueFunction'),
        'launch.substitutions': ('LaunchConfiguration', 'PathJoinSubstitution'),
        'launch_ros': (),
        'launch_ros.actions': ('Node',),
        'launch_ros.parameter_descriptions': ('ParameterValue',),
        'launch_ros.substitutions': ('FindPackageShare',),
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, classes in made.items():
            module = ModuleType(name)
            for each in classes:
                setattr(module, each, type(each, (Recorded,), {}))
            patch.setitem(sys.modules, name, module)
        yield


def launched() -> list[Any]:
    """The actions of the launch file, in their order."""
    with _without_launch():
        launch_file = runpy.run_path(str(LAUNCH_FILE))
        (actions,) = launch_file['generate_launch_description']().arguments
    return list(actions)


def of_kind(name: str) -> list[Any]:
    """Its actions of one class."""
    return [action for action in launched() if type(action).__name__ == name]


def started(**given: str) -> list[Any]:
    """The nodes that it starts with these arguments."""
    defaults = {each.arguments[0]: each.options['default_value'] for each in of_kind('DeclareLaunchArgument')}
    *_, start = of_kind('OpaqueFunction')
    return list(start.options['function'](defaults | given))
