"""Files and texts of unknown origin cannot exhaust time or memory, nor keep a reader waiting."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.bounded_input import (
    MAX_DEPTH,
    MAX_YAML_NODES,
    parse_json,
    parse_yaml,
    read_bounded,
    read_text,
)
from offradar_ros.errors import ConfigError
from offradar_ros.records import read_tree, structure


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / 'a'
    path.write_bytes(b'12345')
    assert read_bounded(path, 5) == b'12345'
    with pytest.raises(OSError, match='Larger than 4 bytes'):
        read_bounded(path, 4)
    with pytest.raises(FileNotFoundError):
        read_bounded(tmp_path / 'b', 4)


def test_what_is_not_a_regular_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    for path in (tmp_path / 'pipe', tmp_path, Path('/dev/zero')):
        with pytest.raises(OSError, match=r'directory|regular'):
            read_bounded(path, 4)


def test_a_folder_is_named_and_not_left_open(tmp_path: Path) -> None:
    before = len(list(Path('/proc/self/fd').iterdir()))
    with pytest.raises(IsADirectoryError) as refused:
        read_bounded(tmp_path, 4)
    assert refused.value.filename == str(tmp_path)
    assert len(list(Path('/proc/self/fd').iterdir())) == before


def test_a_file_without_an_end_is_refused() -> None:
    """The kernel gives the size of this file as 0."""
    with pytest.raises(OSError, match='Larger than 1000 bytes'):
        read_bounded('/proc/kallsyms', 1000)


def test_text_is_utf_8(tmp_path: Path) -> None:
    (tmp_path / 'a').write_bytes(b'\xff')
    with pytest.raises(ValueError, match='utf-8'):
        read_text(tmp_path / 'a')


def _laughs(levels: int, width: int = 10, laugh: str = 'ha') -> str:
    lines = [f'a0: &a0 {laugh}']
    lines += [f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * width)}]' for i in range(1, levels)]
    return '\n'.join(lines)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (_laughs(5000, 2), 'by aliases|deeper'),
        (_laughs(7, laugh='""'), f'more than {MAX_YAML_NODES} values'),
        (_laughs(8), f'more than {MAX_YAML_NODES} values'),
        ('a: &a ' + 'x' * 1_000_000 + '\nb: [' + ', '.join(['*a'] * 1000) + ']', 'by aliases'),
        ('[' * (MAX_DEPTH + 2) + ']' * (MAX_DEPTH + 2), 'deeper'),
        ('[' * 100_000, 'deeper|expected'),
        ('&a [*a]', 'inside its own anchor'),
        ('&a {b: &b [*a]}', 'inside its own anchor'),
        ('x' * 5_000_000, 'longer than'),
    ],
)
def test_yaml_that_would_grow_without_bound(text: str, problem: str) -> None:
    with pytest.raises((ValueError, yaml.YAMLError), match=problem):
        parse_yaml(text)


@pytest.mark.parametrize(
    'text', ['a: 1\nb: 2\na: 3', '{a: 1, a: 1}', 'x: {y: [{a: 1, "a": 2}]}', '/**: {a: 1}\n/**: {b: 2}']
)
def test_a_key_that_is_there_twice_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r'line \d: .* is there twice, first in line 1'):
        parse_yaml(text)


def test_a_key_that_is_there_twice_is_told_in_one_short_line() -> None:
    for key in ('"a\\nb"', '"\\e[31m"', 'x' * 1000):
        with pytest.raises(ValueError, match='is there twice') as refused:
            parse_yaml(f'? {key}\n: 1\n? {key}\n: 2\n')
        assert str(refused.value).isprintable()
        assert len(str(refused.value)) < 120


@pytest.mark.parametrize('text', ['1: a\n0x1: b', 'yes: a\ntrue: b', 'x: {<<: {1: a, 01: b}}', '1.0: a\n1: b'])
def test_keys_that_are_written_in_two_ways_are_there_twice(text: str) -> None:
    with pytest.raises(ValueError, match=r'line \d: .* is there twice, first in line 1, as '):
        parse_yaml(text)


def test_a_key_of_json_that_is_there_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="'a' is there twice in one object"):
        parse_json('[{"a": 1, "b": {"a": 2}, "a": 3}]')


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('!!int ""', "'' is no int"),
        ('!!float ""', "'' is no float"),
        ('!!float x', "'x' is no float"),
        ('!!bool maybe', "'maybe' is no bool"),
        ('!!timestamp x', "'x' is no timestamp"),
        ('{!!int "": 1}', "'' is no int"),
        ('2001-99-99', "'2001-99-99' is no timestamp"),
        ('0x' + 'f' * 401, 'number of over 400 digits'),
    ],
)
def test_a_value_that_is_not_what_its_tag_says_is_refused_with_its_line(
    tmp_path: Path, text: str, problem: str
) -> None:
    (tmp_path / 'a.yaml').write_text(f'b: 1\na: {text}\n')
    with pytest.raises(ConfigError) as caught:
        read_tree(tmp_path / 'a.yaml')
    assert str(caught.value) == f'{tmp_path / "a.yaml"}: not a readable YAML file (line 2: {problem})'


@pytest.mark.parametrize('text', ['1' * 100_000, '1:' * 50_000 + '1', '1:' * 50_000 + '1.5'])
def test_a_long_number_is_refused_in_a_time_that_grows_with_its_length(text: str) -> None:
    started = time.process_time()
    with pytest.raises(yaml.YAMLError, match='number of over 400 digits'):
        parse_yaml(text)
    assert time.process_time() - started < 2.0


def test_a_text_is_refused_as_soon_as_it_is_beyond_the_bounds() -> None:
    beyond = f'- {"x" * 10}\n' * (MAX_YAML_NODES + 1)
    with pytest.raises(ValueError, match=f'more than {MAX_YAML_NODES} values'):
        parse_yaml(beyond + '}')


def test_a_key_of_its_own_beside_merged_ones_is_no_second() -> None:
    assert parse_yaml('a: &a {b: 1, c: 2}\nd:\n  <<: *a\n  b: 3') == {'a': {'b': 1, 'c': 2}, 'd': {'b': 3, 'c': 2}}


def test_aliases_within_bounds_are_read() -> None:
    assert parse_yaml('a: &a {b: 1}\nc: [*a, *a]') == {'a': {'b': 1}, 'c': [{'b': 1}, {'b': 1}]}
    chain = ''.join(f'a{i}: &a{i} [*a{i - 1}]\n' for i in range(1, MAX_DEPTH + 3))
    with pytest.raises(ValueError, match='deeper'):
        parse_yaml('a0: &a0 1\n' + chain)


def test_the_deepest_text_is_read() -> None:
    text = '[' * MAX_DEPTH + ']' * MAX_DEPTH
    assert parse_json(text) == parse_yaml(text)


def test_a_number_with_an_exponent_is_one() -> None:
    assert parse_yaml('[1e-5, -2E3, 3.e1]') == [1e-5, -2000.0, 30.0]


@pytest.mark.parametrize('text', ['[' * 100_000, '{"a":' * 100 + '1' + '}' * 100, '[' * 70 + ']' * 70, ' ' * 5_000_000])
def test_json_beyond_bounds(text: str) -> None:
    with pytest.raises(ValueError, match=r'deeper|longer'):
        parse_json(text)


trees = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text('ab é', max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text('ab', max_size=2), inner, max_size=3),
)


@given(trees)
def test_texts_within_bounds_are_read_as_they_were_written(tree: object) -> None:
    assert parse_yaml(yaml.safe_dump(tree, allow_unicode=True)) == tree


def test_an_error_about_a_huge_value_is_short(tmp_path: Path) -> None:
    path = tmp_path / 'a.yaml'
    path.write_text('x: ' + 'y' * 3_000_000 + ': z')
    with pytest.raises(ConfigError) as caught:
        read_tree(path)
    assert len(str(caught.value)) < 2000
    for value in ('y' * 10**7, ['y'] * 10**6, {'y' * 10**7: 1}):
        with pytest.raises(ConfigError) as caught:
            structure(dict[str, float], {'a': value})
        assert len(str(caught.value)) < 2000
