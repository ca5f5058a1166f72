from __future__ import annotations

from pathlib import Path

import pytest

from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.shipped import shipped_file


def test_a_name_gives_a_shipped_file() -> None:
    assert read_protocol('held_out').name == 'held_out'


def test_a_path_is_returned_unchanged() -> None:
    assert shipped_file('protocols', 'my/own.yaml') == Path('my/own.yaml')


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r'expected a YAML file or one of the protocols .* held_out, '):
        shipped_file('protocols', 'helt_out')


def test_a_workspace_of_colcon_is_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / 'share' / 'offradar_ros' / 'params' / 'protocols'
    folder.mkdir(parents=True)
    (folder / 'mine.yaml').write_text('name: mine\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert shipped_file('protocols', 'mine') == folder / 'mine.yaml'
