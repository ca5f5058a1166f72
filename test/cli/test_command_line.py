"""The command line as a whole: as a process, its version, and unknown commands and options."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
import types
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from offradar_ros import __version__
from offradar_ros.cli.main import COMMANDS
from offradar_ros.config import Config, load_config, read_parameters


def process(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-m', 'offradar_ros.cli.main', *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)


def test_a_process_prints_the_version() -> None:
    ran = process('--version')
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, f'offradar_ros {__version__}\n', '')


def test_an_error_of_a_process_is_one_line_and_status_1(tmp_path: Path) -> None:
    ran = process('check', str(tmp_path / 'nothing'))
    assert (ran.returncode, ran.stdout) == (1, '')
    assert ran.stderr == f'error: {tmp_path / "nothing"}: no such folder\n'


@pytest.mark.parametrize(
    ('arguments', 'expected'),
    [
        (['chekc'], 'No such command'),
        (['check'], 'Missing argument'),
        (['check', '--colour', 'x'], 'No such option'),
        (['simulate', 'out', '--scans', '0'], 'Invalid value'),
        (['simulate', 'out', '--degraded', '1.5'], 'Invalid value'),
    ],
)
def test_unknown_commands_and_options_are_reported(
    offradar: Callable[..., Any], arguments: list[str], expected: str
) -> None:
    ran = offradar(*arguments)
    assert ran.status == 2
    assert expected in ran.err
    assert 'Traceback' not in ran.err


def is_union(annotation: Any) -> bool:
    """Whether `X | Y` is the annotation or a part of it."""
    return isinstance(annotation, types.UnionType) or any(map(is_union, typing.get_args(annotation)))


@pytest.mark.parametrize('command', COMMANDS)
def test_options_have_types_that_the_typer_of_ubuntu_knows(command: str) -> None:
    """Its version is 0.9, which fails on `X | None` and on annotations that are strings."""
    module, _, name = COMMANDS[command].partition(':')
    try:
        function = getattr(importlib.import_module(f'offradar_ros.{module}'), name)
    except ImportError as error:
        pytest.skip(f'{command} needs {error.name}')
    for option, parameter in inspect.signature(function).parameters.items():
        assert not isinstance(parameter.annotation, str), option
        assert not is_union(parameter.annotation), option


def test_help_names_every_command(done: Callable[..., str]) -> None:
    printed = done('--help')
    commands = ('check', 'convert', 'simulate', 'calibrate', 'drive', 'map', 'session', 'export', 'parameters', 'demo')
    assert all(f'│ {command} ' in printed for command in commands)


def test_parameters_are_printed_and_written(
    done: Callable[..., str], refused: Callable[..., str], tmp_path: Path
) -> None:
    assert '| `query.delta` |' in done('parameters')
    done('parameters', '--out', tmp_path / 'all.yaml')
    assert read_parameters(tmp_path / 'all.yaml')
    assert load_config(tmp_path / 'all.yaml') == Config()
    assert 'cannot be written' in refused('parameters', '--out', tmp_path / 'none' / 'all.yaml')


def test_the_demonstration_reports_what_it_needs(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('importlib.util.find_spec', lambda name: None)
    printed = refused('demo', '--out', tmp_path)
    assert (
        "the demo needs rclpy: source a ROS 2 installation, or pip install '.[ros]' in the project's folder" in printed
    )


def test_export_asks_for_the_file_before_it_asks_for_torch(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'offradar_ros.encoders.networks.files', None)
    assert 'nope: no such weights file' in refused('export', tmp_path / 'nope', tmp_path / 'out.onnx')
    (tmp_path / 'weights.safetensors').write_text('')
    printed = refused('export', tmp_path / 'weights.safetensors', tmp_path / 'out.onnx')
    assert "export needs torch and onnx: pip install '.[torch]' in the project's folder" in printed


def test_the_demonstration_empties_no_other_folder(refused: Callable[..., str], tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    pytest.importorskip('matplotlib')
    (tmp_path / 'thesis.tex').write_text('years of work')
    assert 'holds other files than those of a demonstration' in refused('demo', '--out', tmp_path)
    assert (tmp_path / 'thesis.tex').exists()
