"""The configuration is the same in Python and in YAML, and its errors name the parameter."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.config import (
    Config,
    Parameter,
    QueryConfig,
    load_config,
    parameters,
    read_parameters,
    replace_values,
    write_parameters,
)
from offradar_ros.errors import ConfigError

LEAVES = {leaf.name: leaf for leaf in parameters(Config())}


def allowed_values(leaf: Parameter) -> st.SearchStrategy[Any]:
    """All values within the bounds of a parameter."""
    bounds = leaf.bounds
    if bounds.choices:
        return st.sampled_from(bounds.choices)
    if isinstance(leaf.value, bool):
        return st.booleans()
    if isinstance(leaf.value, int):
        return st.integers(int(bounds.minimum or 0), int(bounds.maximum or 0))
    if isinstance(leaf.value, float):
        return st.floats(bounds.minimum, bounds.maximum)
    return st.text(st.characters(blacklist_categories=['Cs', 'Cc']), max_size=20)


allowed = st.lists(st.sampled_from(sorted(LEAVES)), unique=True, max_size=6).flatmap(
    lambda names: st.fixed_dictionaries({name: allowed_values(LEAVES[name]) for name in names})
)


@pytest.mark.parametrize('name', sorted(LEAVES))
def test_every_parameter_has_a_description_and_an_allowed_default(name: str) -> None:
    leaf = LEAVES[name]
    assert len(leaf.bounds.description) > 10 and '\n' not in leaf.bounds.description
    assert leaf.bounds.problem(leaf.value) is None
    if isinstance(leaf.value, (int, float)) and not isinstance(leaf.value, bool):
        assert leaf.bounds.minimum is not None and leaf.bounds.maximum is not None
    if name.endswith('_per_m'):
        assert leaf.bounds.unit == '1/m'
    elif name.rsplit('_', 1)[-1] in ('m', 's', 'rad', 'px', 'bytes'):
        assert leaf.bounds.unit == name.rsplit('_', 1)[-1]


@settings(max_examples=60, deadline=None)
@given(allowed)
def test_python_and_yaml_give_the_same_configuration(
    tmp_path_factory: pytest.TempPathFactory, values: dict[str, Any]
) -> None:
    if values.get('query.level', 10) > values.get('query.levels', 10):
        with pytest.raises(ConfigError, match=r'query\.level: expected at most query\.levels'):
            load_config(overrides=values)
        return
    least, most = 'localisation.keep_probability', 'localisation.decide_probability'
    if values.get(least, LEAVES[least].value) > values.get(most, LEAVES[most].value):
        with pytest.raises(ConfigError, match=rf'{least}: expected at most {most}'):
            load_config(overrides=values)
        return
    config = load_config(overrides=values)
    leaves = {leaf.name: leaf.value for leaf in parameters(config)}
    assert leaves == {name: leaf.value for name, leaf in LEAVES.items()} | values
    path = tmp_path_factory.mktemp('config') / 'params.yaml'
    write_parameters(path, leaves, comment='Two lines\nof comment')
    assert load_config(path) == config
    assert path.read_text(encoding='utf-8').startswith('# Two lines\n# of comment\n/**:')


def test_overrides_have_priority_over_a_file(tmp_path: Path) -> None:
    path = tmp_path / 'params.yaml'
    path.write_text('map:\n  match_distance_m: 25\n  replace: worst\n')
    config = load_config(path, {'map.replace': 'all'})
    assert (config.map.match_distance_m, config.map.replace) == (25.0, 'all')
    assert type(config.map.match_distance_m) is float
    assert config.query == QueryConfig()


def test_any_node_s_parameters_and_plain_ones_are_read(tmp_path: Path) -> None:
    path = tmp_path / 'params.yaml'
    path.write_text('/**:\n  ros__parameters:\n    map: {replace: all}\nquery.top_k: 3\n/x:\n  ros__parameters:\n')
    assert read_parameters(path) == {'map.replace': 'all', 'query.top_k': 3}
    path.write_text('/**: {ros__parameters: {map.replace: all}}\n/encoder: {ros__parameters: {map.replace: none}}')
    assert read_parameters(path) == {'map.replace': 'none'}


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', 'holds no parameters'),
        ('# all of it is commented out\n', 'holds no parameters'),
        ('map: {replace: all}\nmap: {match_distance_m: 3}', "line 2: 'map' is there twice, first in line 1"),
        ('map: {replace: all}\nmap.replace: nearest', 'map.replace is there twice, with dots and as a mapping'),
        (
            '/car1/encoder: {ros__parameters: {radar.range_resolution_m: 0.04}}\n'
            '/car2/encoder: {ros__parameters: {radar: {range_resolution_m: 0.06}}}',
            'radar.range_resolution_m is 0.04 for /car1/encoder and 0.06 for /car2/encoder: expected a file for each',
        ),
        (
            '/a: {ros__parameters: {map.undo_depth: 1}}\n/**: {ros__parameters: {map.undo_depth: 2}}\n'
            '/b: {ros__parameters: {map.undo_depth: 2}}',
            'map.undo_depth is 1 for /a and 2 for /b: expected a file for each',
        ),
    ],
)
def test_a_file_of_which_something_would_be_lost_is_refused(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        read_parameters(path)
    assert problem in str(refused.value)
    assert str(refused.value).count(str(path)) == 1


def test_nodes_that_agree_and_have_their_own_settings_may_be_in_one_file(tmp_path: Path) -> None:
    path = tmp_path / 'params.yaml'
    path.write_text(
        '/encoder: {ros__parameters: {map.replace: all, use_sim_time: true}}\n'
        '/query: {ros__parameters: {map.replace: all, use_sim_time: false}}'
    )
    assert load_config(path).map.replace == 'all'
    path.write_text(
        '/encoder: {ros__parameters: {map.replace: all}}\n/**: {ros__parameters: {map.replace: none}}\n'
        '/query: {ros__parameters: {map.replace: all}}'
    )
    assert load_config(path).map.replace == 'all'


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'map.match_distance': 5.0}, 'parameter map.match_distance is unknown'),
        ({'map': 5}, 'parameter map is unknown'),
        ({'map.match_distance_m': 0.0}, 'parameter map.match_distance_m: expected at least 0.01 m, got 0'),
        ({'map.match_distance_m': 1e9}, 'expected at most 1000 m, got 1e\\+09'),
        ({'map.match_distance_m': math.nan}, 'expected a finite number, got nan'),
        ({'map.match_distance_m': math.inf}, 'expected a finite number'),
        ({'map.match_distance_m': '5'}, "expected a finite number, got '5'"),
        ({'map.match_distance_m': True}, 'expected a finite number, got True'),
        ({'map.match_distance_m': 10**400}, 'map.match_distance_m: expected a number of 64 bits'),
        ({'query.top_k': 10**400}, 'query.top_k: expected a number of 64 bits'),
        ({'query.top_k': 2.0}, 'expected a whole number, got 2.0'),
        ({'query.top_k': True}, 'expected a whole number, got True'),
        ({'map.insert_unmatched': 1}, 'expected true or false, got 1'),
        ({'map.path': None}, 'expected text, got None'),
        ({'map.replace': 'best'}, "expected one of nearest, worst, all, got 'best'"),
        ({'query.level': 11}, r'query\.level: expected at most query\.levels = 10, got 11'),
    ],
)
def test_a_wrong_value_is_named_with_what_was_expected(values: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words) as wrong:
        replace_values(Config(), values)
    assert '\n' not in str(wrong.value)


def test_values_with_a_common_condition_are_set_together() -> None:
    config = replace_values(Config(), {'query.level': 50, 'query.levels': 100})
    assert (config.query.level, config.query.levels) == (50, 100)


@pytest.mark.parametrize(
    'text',
    [
        'a: [1',
        '- a',
        'a: 2001-99-99',
        'a: &a {b: *a}',
        '? [1]\n: 2',
        '\x00',
        'a: !!python/object/apply:os.getcwd []',
        '/**: {ros__parameters: [1]}',
        'a: ' + '[' * 3000,
        'just words',
        '1: 2',
    ],
)
def test_a_file_that_holds_no_parameters_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError) as wrong:
        load_config(path)
    assert '\n' not in str(wrong.value)
    assert str(path) in str(wrong.value) or 'parameter 1 is unknown' in str(wrong.value)


def test_an_unknown_name_is_reported_with_the_most_similar_one() -> None:
    def error_of(name: str) -> str:
        with pytest.raises(ConfigError) as wrong:
            replace_values(Config(), {name: 1})
        return str(wrong.value)

    assert error_of('query.levle') == 'parameter query.levle is unknown: did you mean query.level?'
    assert error_of('delta') == 'parameter delta is unknown: did you mean query.delta?'
    assert error_of('zzz') == 'parameter zzz is unknown: offradar parameters lists all'
    assert 'query.storage was removed' in error_of('query.storage')
    assert 'delete it from your parameters' in error_of('query.storage')
    assert error_of('a\nb').startswith("parameter 'a\\nb' is unknown: ")


def test_node_parameters_in_a_file_are_not_part_of_the_configuration(tmp_path: Path) -> None:
    path = tmp_path / 'params.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    use_sim_time: true\n    autostart: false\n    map: {match_distance_m: 7}\n'
        '    start_type_description_service: false\n'
        '    qos_overrides: {/gps/fix: {subscription: {depth: 3}}}\n'
    )
    assert load_config(path) == replace_values(Config(), {'map.match_distance_m': 7})
    read = read_parameters(path)
    assert (read['use_sim_time'], read['qos_overrides./gps/fix.subscription.depth']) == (True, 3)
    write_parameters(tmp_path / 'again.yaml', read)
    assert read_parameters(tmp_path / 'again.yaml') == read


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=60) | st.text(alphabet='ab:{}[]&*!?-# \n\t\'"0./', max_size=60).map(str.encode))
def test_any_file_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp('config') / 'params.yaml'
    path.write_bytes(content)
    try:
        load_config(path)
    except ConfigError as wrong:
        assert '\n' not in str(wrong)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'nowhere\.yaml: no such file$'):
        load_config(tmp_path / 'nowhere.yaml')


def test_configurations_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Config().map.replace = 'all'  # type: ignore[misc]  # what must fail
