"""The launch file ends with one line where it would start nodes that nobody meant."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from launch_stand_in import of_kind, started


@pytest.fixture
def check() -> Callable[[Path], None]:
    """The check of `params:=PATH`, which comes before the nodes."""
    check, start = of_kind('OpaqueFunction')
    assert start.options['function'].__name__ == 'start_nodes'
    return lambda path: check.options['function']({'params': str(path)})


def test_a_parameter_file_that_is_missing_ends_the_launch(check: Callable[[Path], None], tmp_path: Path) -> None:
    for absent in (tmp_path / 'car.yaml', tmp_path):
        with pytest.raises(RuntimeError, match=r'^params:=.*: no such file: expected a parameter file') as refused:
            check(absent)
        assert len(str(refused.value).splitlines()) == 1


def test_a_parameter_file_is_accepted(check: Callable[[Path], None], tmp_path: Path) -> None:
    (tmp_path / 'car.yaml').write_text('/**:\n  ros__parameters: {}\n')
    check(tmp_path / 'car.yaml')


def test_a_parameter_file_that_may_not_be_read_ends_the_launch(
    check: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'car.yaml').write_text('/**:\n  ros__parameters: {}\n')
    # As for a user who is not root.
    monkeypatch.setattr('os.access', lambda path, mode: mode != os.R_OK)
    with pytest.raises(RuntimeError, match=r'^params:=.*car\.yaml: cannot be read: change its permissions$'):
        check(tmp_path / 'car.yaml')


def test_nodes_start_again_only_if_that_is_asked_for() -> None:
    declared: dict[str, Any] = {each.arguments[0]: each.options for each in of_kind('DeclareLaunchArgument')}
    assert declared['respawn']['default_value'] == 'false'
    nodes = started()
    assert [node.options['respawn'].arguments for node in nodes] == [('respawn',)] * 3
    assert all(node.options['respawn_delay'] > 0 for node in nodes)


def parameters(**given: str) -> dict[str, dict[str, str]]:
    """By node, its parameters besides those of the file, which they override, and the argument of each."""
    found = {}
    for node in started(**given):
        file, *others = node.options['parameters']
        assert file.arguments == ('params',)
        own = {name: value.arguments[0].arguments[0] for each in others for name, value in each.items()}
        found[node.options['name']] = own
    return found


def test_what_is_not_given_does_not_override_the_parameter_file() -> None:
    assert parameters() == {'encoder': {}, 'map_server': {}, 'query': {}}
    assert parameters(map='/data/town.db') == {
        'encoder': {},
        'map_server': {'map.path': 'map'},
        'query': {'query.map_path': 'map'},
    }
    for value in ('true', 'false'):
        clock = {'use_sim_time': 'use_sim_time'}
        assert parameters(use_sim_time=value) == {'encoder': clock, 'map_server': clock, 'query': clock}


def test_values_are_of_the_types_of_the_parameters() -> None:
    """`use_sim_time:=true` is no text, and a map whose name is 2024 is no number."""
    kinds = {
        name: value.options['value_type']
        for node in started(map='2024', use_sim_time='true')
        for name, value in node.options['parameters'][1].items()
    }
    assert kinds == {'map.path': str, 'query.map_path': str, 'use_sim_time': bool}


def test_scans_are_remapped_with_their_compressed_topic() -> None:
    encoder, *_ = started()
    topics = dict(encoder.options['remappings'])
    (argument, suffix) = topics['radar_data/b_scan_image/compressed']
    assert topics['radar_data/b_scan_image'].arguments == argument.arguments == ('scans',)
    assert suffix == '/compressed'


@pytest.mark.parametrize('given', [None, '', '/car/fastdds.xml'])
def test_the_profile_is_ours_unless_the_environment_names_one(
    monkeypatch: pytest.MonkeyPatch, given: str | None
) -> None:
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE', raising=False)
    if given is not None:
        monkeypatch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', given)
    declared = {each.arguments[0]: each.options['default_value'] for each in of_kind('DeclareLaunchArgument')}
    profile = declared['dds_profile']
    if given:
        assert profile == given
    else:
        assert profile.arguments[0][1:] == ['params', 'fastdds.xml']


def test_every_argument_says_what_it_is() -> None:
    assert all(each.options['description'] for each in of_kind('DeclareLaunchArgument'))
