"""Parameter files are for the nodes that they name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from offradar_ros.config import write_parameters
from offradar_ros.errors import ConfigError
from offradar_ros.ros.parameter_files import check_parameter_files, not_addressed

VALUES = '{ros__parameters: {a: 1}}'


def arguments(*paths: Path) -> list[str]:
    return ['node', 'x', '--ros-args', *(word for path in paths for word in ('--params-file', str(path)))]


@pytest.mark.parametrize(
    ('text', 'node', 'is_for_it'),
    [
        (f'/**: {VALUES}', '/encoder', True),
        (f'/**: {VALUES}', '/car/radar/encoder', True),
        (f'"**": {VALUES}', '/encoder', True),
        (f'encoder: {VALUES}', '/encoder', True),
        (f'/encoder: {VALUES}', '/encoder', True),
        (f'encoder: {VALUES}', '/car/encoder', False),
        (f'/car/encoder: {VALUES}', '/car/encoder', True),
        (f'car: {{encoder: {VALUES}}}', '/car/encoder', True),
        (f'/**/encoder: {VALUES}', '/encoder', True),
        (f'/**/encoder: {VALUES}', '/car/radar/encoder', True),
        (f'/*/encoder: {VALUES}', '/car/encoder', True),
        (f'/*/encoder: {VALUES}', '/encoder', False),
        (f'/encoder2: {VALUES}', '/encoder', False),
        ('encoder: {a: 1}', '/encoder', False),
        (f'/query: {VALUES}\n/encoder: {VALUES}', '/encoder', True),
    ],
)
def test_a_file_is_for_the_nodes_that_it_names(tmp_path: Path, text: str, node: str, is_for_it: bool) -> None:
    path = tmp_path / 'car.yaml'
    path.write_text(text)
    found = not_addressed(arguments(path), node)
    assert len(found) == (not is_for_it)
    for line in found:
        assert line.startswith(f'{path}: has no parameters for {node}, only for ')


@pytest.mark.parametrize(
    'text', [']{', '- 1', 'a', '1: {ros__parameters: {}}', '\x00', 'a: &a [*a]', '{' * 1000, 'a: ' + 'x' * 5_000_000]
)
def test_what_is_no_parameter_file_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'car.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match=r'car\.yaml') as refused:
        check_parameter_files(arguments(path))
    assert len(str(refused.value).splitlines()) == 1


def test_a_file_that_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    for path in (tmp_path / 'pipe', tmp_path, tmp_path / 'nothing', Path('/dev/zero')):
        with pytest.raises(ConfigError, match=f'--params-file {path}: cannot be read'):
            check_parameter_files(arguments(path))


def test_only_arguments_for_ros_are_files() -> None:
    for line in (['node', '--params-file', '/no'], ['node', '--ros-args', '--', '--params-file', '/no'], ['node'], []):
        check_parameter_files(line)


def test_an_option_without_its_file_is_left_to_ros() -> None:
    check_parameter_files(['node', '--ros-args', '--params-file'])


def test_values_that_are_not_those_of_the_digest_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'car.yaml'
    write_parameters(path, {'query.threshold': 0.5}, with_digest=True)
    check_parameter_files(arguments(path))
    path.write_text(path.read_text().replace('0.5', '0.4'))
    with pytest.raises(ConfigError, match=rf'--params-file {path}: its values are not those of its digest'):
        check_parameter_files(arguments(path))
