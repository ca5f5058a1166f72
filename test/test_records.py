"""Records are read as they were written, and invalid files are refused in one line."""

from __future__ import annotations

import dataclasses
import math
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unprivileged import obey_permissions

from offradar_ros.bounded_input import parse_yaml
from offradar_ros.errors import ConfigError
from offradar_ros.records import (
    Measure,
    flatten,
    read_record,
    replace,
    require_writable,
    structure,
    to_json,
    to_yaml,
    unstructure,
    write_record,
)


class AtLeastZero:
    def problem(self, value: object) -> str | None:
        return f'expected at least 0, got {value}' if isinstance(value, float) and value < 0.0 else None


@dataclasses.dataclass(frozen=True)
class Street:
    name: str
    length_m: float = dataclasses.field(default=1.0, metadata={'bounds': AtLeastZero()})

    def __post_init__(self) -> None:
        if not self.name:
            raise ConfigError('street: expected a name')


@dataclasses.dataclass(frozen=True)
class Town:
    count: int
    open: bool = True
    streets: tuple[Street, ...] = ()
    corners: tuple[tuple[float, ...], ...] = ()
    by_name: Mapping[str, Street] = dataclasses.field(default_factory=dict)
    mayor: Street | None = None
    height_m: float | None = None
    centre: Street = dataclasses.field(default_factory=lambda: Street('centre', 2.0))


names = st.text(max_size=8)
numbers = st.floats(0.0, 1e300)
streets = st.builds(Street, names.filter(bool), numbers)
towns = st.builds(
    Town,
    st.integers(),
    st.booleans(),
    st.lists(streets, max_size=2).map(tuple),
    st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=2).map(tuple), max_size=2).map(tuple),
    st.dictionaries(names, streets, max_size=2),
    st.none() | streets,
    st.none() | numbers,
    streets,
)


@settings(max_examples=80, deadline=None)
@given(towns)
def test_a_record_is_read_as_it_was_written(tmp_path_factory: pytest.TempPathFactory, town: Town) -> None:
    folder = tmp_path_factory.mktemp('town')
    assert structure(Town, unstructure(town)) == town
    for path in (folder / 'town.yaml', folder / 'town.json'):
        write_record(path, town)
        assert read_record(Town, path) == town
    assert sorted(path.name for path in folder.iterdir()) == ['town.json', 'town.yaml']


@pytest.mark.parametrize(
    ('tree', 'message'),
    [
        ({}, 'key count is missing'),
        ({'count': 1.0}, 'key count: expected a whole number, got 1.0'),
        ({'count': True}, 'key count: expected a whole number, got True'),
        ({'count': '1'}, "key count: expected a whole number, got '1'"),
        ({'count': 1, 'open': 1}, 'key open: expected true or false, got 1'),
        ({'count': 1, 'height_m': math.nan}, 'key height_m: expected a finite number, got nan'),
        ({'count': 1, 'height_m': True}, 'key height_m: expected a finite number, got True'),
        ({'count': 1, 'height_m': 10**400}, 'key height_m: expected a finite number, got 1000'),
        ({'count': 1, 'streets': [{'name': 'a'}, {'name': 3}]}, 'key streets[1].name: expected text, got 3'),
        ({'count': 1, 'streets': [{}]}, 'key streets[0].name is missing'),
        ({'count': 1, 'streets': [{'nmae': 'a'}]}, 'key streets[0].nmae is unknown: did you mean name?'),
        ({'count': 1, 'streets': [{'name': ''}]}, 'street: expected a name'),
        (
            {'count': 1, 'streets': [{'name': 'a', 'length_m': -1.0}]},
            'streets[0].length_m: expected at least 0, got -1',
        ),
        ({'count': 1, 'streets': 'abc'}, "key streets: expected a list, got 'abc'"),
        ({'count': 1, 'streets': {}}, 'key streets: expected a list, got {}'),
        ({'count': 1, 'streets': [3]}, 'key streets[0]: expected a mapping of keys, got int'),
        ({'count': 1, 'corners': [[0, 1], [0, 'x']]}, "key corners[1][1]: expected a finite number, got 'x'"),
        ({'count': 1, 'by_name': {'a b': {}}}, "key by_name['a b'].name is missing"),
        ({'count': 1, 'by_name': 3}, 'key by_name: expected a mapping of keys, got int'),
        ({'count': 1, 'mayor': 'x'}, 'key mayor: expected a mapping of keys, got str'),
        ({'count': 1, 'zzz\n': 1}, "key 'zzz\\n' is unknown"),
        ({'count': 'x', 1: 2}, 'key 1 is unknown'),
        ([], 'expected a mapping of keys, got list'),
        (None, 'expected a mapping of keys, got NoneType'),
    ],
)
def test_an_error_is_one_line_with_the_key(tmp_path: Path, tree: Any, message: str) -> None:
    with pytest.raises(ConfigError) as wrong:
        structure(Town, tree)
    assert message in str(wrong.value)
    assert '\n' not in str(wrong.value)
    (tmp_path / 'town.yaml').write_text(to_yaml(tree))
    with pytest.raises(ConfigError) as wrong:
        read_record(Town, tmp_path / 'town.yaml')
    assert str(wrong.value).startswith(f'{tmp_path / "town.yaml"}: ')


def test_an_integer_is_also_a_float_and_an_optional_value_may_be_null() -> None:
    town = structure(Town, {'count': 1, 'height_m': 2, 'mayor': None, 'corners': [[1]]})
    assert (type(town.height_m), town.mayor, town.corners) == (float, None, ((1.0,),))


def test_replace_sets_all_values_and_then_checks_the_record() -> None:
    town = Town(1, streets=(Street('a'),))
    changed = replace(town, {'centre.length_m': 3, 'count': 2})
    assert changed == dataclasses.replace(town, count=2, centre=Street('centre', 3.0))
    for values, message in (
        ({'centre.lenght_m': 1}, 'key centre.lenght_m is unknown: did you mean centre.length_m?'),
        ({'centre': 1}, 'key centre is unknown'),
        ({'centre.length_m': -1.0}, 'key centre.length_m: expected at least 0, got -1.0'),
        ({'centre.name': ''}, 'street: expected a name'),
    ):
        with pytest.raises(ConfigError) as wrong:
            replace(town, values)
        assert str(wrong.value).startswith(message)


@pytest.mark.parametrize(
    ('name', 'text', 'message'),
    [
        ('a.yaml', 'a: [1', 'not a readable YAML file'),
        ('a.yaml', 'a: &a {b: *a}', 'not a readable YAML file'),
        ('a.yaml', 'a: &a [*a]', 'not a readable YAML file'),
        ('a.yaml', 'a: !!python/object/apply:os.getcwd []', 'not a readable YAML file'),
        ('a.yaml', 'a: 2001-99-99', 'not a readable YAML file'),
        ('a.json', '{"count": 1', 'not a readable JSON file'),
        ('a.json', '[' * 100_000, 'not a readable JSON file'),
        ('a.json', '{"count": 1, "height_m": NaN}', 'key height_m: expected a finite number, got nan'),
    ],
)
def test_an_unreadable_file_is_named(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError) as wrong:
        read_record(Town, tmp_path / name)
    assert str(wrong.value).startswith(f'{tmp_path / name}: {message}')
    assert '\n' not in str(wrong.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'nowhere\.json: no such file$'):
        read_record(Town, tmp_path / 'nowhere.json')


@pytest.mark.parametrize('text', ['1e-5', '1E5', '+1e3', '-2.5e7', '.5e1', '1.5e-3'])
def test_numbers_with_an_exponent_are_numbers_and_quoted_ones_are_text(text: str) -> None:
    assert parse_yaml(text) == float(text)
    assert parse_yaml(to_yaml({'a': text})) == {'a': text}


@pytest.mark.parametrize(
    ('content', 'problem'),
    [
        (b'query:\n\ttop_k: 5\n', r"line 2: found character '\\t' that cannot start any token"),
        (b'query: {top_k: 5\n', r"line 2: expected ',' or '}'"),
        ('query: 1'.encode('utf-16'), 'expected UTF-8 text'),
        (b'a: *b', "line 1: found undefined alias 'b'"),
    ],
)
def test_what_is_wrong_with_a_text_is_said_with_its_line(tmp_path: Path, content: bytes, problem: str) -> None:
    path = tmp_path / 'a.yaml'
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=problem):
        read_record(Town, path)


def test_json_refuses_nan() -> None:
    with pytest.raises(ValueError, match='nan'):
        to_json(Town(1, height_m=math.nan))


def test_a_record_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='cannot be written'):
        write_record(tmp_path / 'nowhere' / 'a.json', Town(1))
    assert list(tmp_path.iterdir()) == []


nested = st.recursive(
    st.integers(), lambda inner: st.dictionaries(st.text('abc', min_size=1, max_size=2), inner, min_size=1, max_size=3)
)


@given(st.dictionaries(st.text('abc', min_size=1, max_size=2), nested, max_size=3))
def test_flattened_names_are_paths_to_their_values(tree: dict[str, Any]) -> None:
    for name, value in flatten(tree).items():
        branch: Any = tree
        for part in name.split('.'):
            branch = branch[part]
        assert branch == value


@dataclasses.dataclass(frozen=True)
class Figures:
    mean: Measure
    by_kind: dict[str, Measure]
    curve: tuple[tuple[Measure, Measure], ...]


def test_measures_that_are_nan_are_null() -> None:
    figures = Figures(math.nan, {'clean': 1.0, 'fog': math.nan}, ((0.0, math.inf), (1.0, 0.5)))
    tree = unstructure(figures)
    assert tree == {'mean': None, 'by_kind': {'clean': 1.0, 'fog': None}, 'curve': [[0.0, None], [1.0, 0.5]]}
    found = structure(Figures, tree)
    assert repr(found) == repr(dataclasses.replace(figures, curve=((0.0, math.nan), (1.0, 0.5))))
    with pytest.raises(ConfigError, match='key mean: expected a finite number, got True'):
        structure(Figures, tree | {'mean': True})
    with pytest.raises(ConfigError, match='key length_m: expected a finite number, got None'):
        structure(Street, {'name': 'a', 'length_m': None})


_WRITE_WHERE_IT_MAY = """
import pathlib, sys
from offradar_ros.errors import OffradarError
from offradar_ros.records import require_writable
from offradar_ros.whole_file import write_whole_file
for path in map(pathlib.Path, sys.argv[1:]):
    done = []
    for attempt in (lambda: require_writable(path), lambda: write_whole_file(path, b'a: 2')):
        try:
            attempt()
            done.append('done')
        except (OSError, OffradarError) as error:
            done.append('Permission denied' if 'Permission denied' in str(error) else repr(error))
    print(*done, sep=', ')
"""


def test_require_writable_tells_of_what_writing_does(tmp_path: Path) -> None:
    """A file is replaced: it is its folder that must be writable."""
    paths = [tmp_path / name / 'params.yaml' for name in ('folder', 'file', 'unseen')]
    for path in paths:
        path.parent.mkdir()
        path.write_text('a: 1')
    paths[0].parent.chmod(0o500)
    paths[1].chmod(0o400)
    paths[2].parent.chmod(0o000)
    try:
        ran = subprocess.run(
            [sys.executable, '-c', _WRITE_WHERE_IT_MAY, *map(str, paths)],
            cwd=Path(__file__).resolve().parents[1],
            capture_output=True,
            text=True,
            check=True,
            preexec_fn=obey_permissions,
        )
    finally:
        for path in paths:
            path.parent.chmod(0o700)
    denied = 'Permission denied, Permission denied'
    assert ran.stdout.splitlines() == [denied, 'done, done', denied]


def test_require_writable_follows_no_link_and_waits_for_no_one(tmp_path: Path) -> None:
    link, pipe = tmp_path / 'link', tmp_path / 'pipe'
    link.symlink_to(tmp_path / 'target')
    require_writable(link)
    os.mkfifo(pipe)
    for like in (b'', None):
        with pytest.raises(ConfigError, match='Not a regular file'):
            require_writable(pipe, like)
    assert link.is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ['link', 'pipe']


def test_require_writable_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / 'params.yaml'
    require_writable(path)
    assert not path.exists()
    path.write_text('map: {replace: all}')
    require_writable(path)
    assert path.read_text() == 'map: {replace: all}'
    for wrong in (tmp_path, tmp_path / 'no' / 'params.yaml', path / 'params.yaml'):
        with pytest.raises(ConfigError, match='cannot be written'):
            require_writable(wrong)
