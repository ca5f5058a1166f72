"""Protocols from YAML, and the messages for invalid ones."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.protocol_file import read_protocol

PROTOCOLS = Path(__file__).resolve().parents[3] / 'params' / 'protocols'
GOOD = """
name: small
title: Two drives
groups: [{name: a, title: A, physics: drawn, cities: [1]}]
lanes: [{}, {left_m: 2}]
validation: {cities: [9]}
"""


@pytest.mark.parametrize('path', sorted(PROTOCOLS.glob('*.yaml')), ids=lambda path: path.stem)
def test_shipped_protocols_are_read_and_share_no_world_with_training(path: Path) -> None:
    protocol = read_protocol(path)
    assert protocol.name == path.stem
    seeds = [seed for group in protocol.groups for seed in group.cities] + list(protocol.validation.cities)
    seeds += [street.seed for group in protocol.groups for street in group.streets]
    # Training counts up from 10,000 and its validation from 900,000.
    assert min(seeds, default=2_000_000) >= 2_000_000
    assert len(set(seeds)) == len(seeds)


def test_held_out_and_quick_protocols_share_no_world() -> None:
    first, second = (
        {seed for group in read_protocol(PROTOCOLS / name).groups for seed in group.cities}
        for name in ('held_out.yaml', 'quick.yaml')
    )
    assert not first & second


def test_the_open_set_protocol_has_the_drives_of_held_out() -> None:
    whole, opened = (read_protocol(PROTOCOLS / f'{name}.yaml') for name in ('held_out', 'held_out_open'))
    assert opened.leaves_out
    assert not whole.leaves_out
    same = {'name': whole.name, 'title': whole.title, 'leave_out': whole.leave_out}
    assert dataclasses.replace(opened, **same) == whole  # type: ignore[arg-type]


def test_a_whole_number_is_read_as_a_float(tmp_path: Path) -> None:
    path = tmp_path / 'p.yaml'
    path.write_text(GOOD)
    assert read_protocol(path).lanes[1].left_m == 2.0


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ('scnas: 5', r'key scnas is unknown: did you mean scans\?'),
        ('scans: many', 'key scans: expected a whole number'),
        ('scans: true', 'key scans: expected a whole number'),
        ('leave_out: thirds', "expected halves, or metres above 0, or neither, got 'thirds' and 0"),
        ('{leave_out: halves, leave_out_m: 50}', "got 'halves' and 50"),
        ('tolerance_m: .nan', 'key tolerance_m: expected a finite number'),
        ('groups: [{name: a, title: A, recorded: [{name: r}]}]', 'recorded r: expected a split, sequences or maps'),
        ('groups: [{name: a, title: A, recorded: [{name: r, maps: [x, x]}]}]', 'recorded r: expected each folder once'),
        ('groups: [{name: a, title: A, paper: 3, cities: [1]}]', 'paper: expected 0, 1 or 2'),
        ('groups: [{name: a, title: A, physics: odd, cities: [1]}]', 'physics: expected one of nominal'),
        ('groups: [{name: a, title: A, physics: drawn}]', 'expected cities, streets or recorded'),
        ('groups: [{name: a, physics: drawn, cities: [1]}]', r'key groups\[0\].title is missing'),
        ('groups: [{name: all, title: A, physics: drawn, cities: [1]}]', 'none of them all or validation'),
        ('groups: [{name: validation, title: A, cities: [1]}]', 'none of them all or validation'),
        ('groups: [{name: a, title: A, cities: [1, 1]}]', 'group a: expected each world once'),
        ('maintenance: {random_repeats: 0}', 'random_repeats of at least 1'),
        ('lanes: [{}]', 'lanes: expected at least two'),
        ('lanes: {}', 'key lanes: expected a list'),
        ('map_spacings_m: [-1]', 'expected numbers from 0'),
        ('drive_spacing_m: 0', 'expected metres above 0 for simulated'),
        ('negative_m: 20', 'the second not below the first'),
        ('rejections: [1.0]', 'expected shares'),
        ('validation: {scans: 0}', 'validation: expected at least one scan'),
    ],
)
def test_an_invalid_key_is_named_in_one_line(tmp_path: Path, change: str, message: str) -> None:
    path = tmp_path / 'p.yaml'
    tree = yaml.safe_load(GOOD) | yaml.safe_load(change)
    path.write_text(yaml.safe_dump(tree))
    with pytest.raises(ConfigError, match=message) as refused:
        read_protocol(path)
    assert str(refused.value).startswith(str(path))
    assert '\n' not in str(refused.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='no such file'):
        read_protocol(tmp_path / 'none.yaml')


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 10**6) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from([*Protocol.__dataclass_fields__, 'other']), VALUES, max_size=4), st.booleans())
def test_an_arbitrary_tree_is_a_protocol_or_a_config_error(
    tmp_path_factory: pytest.TempPathFactory, tree: dict[str, Any], whole: bool
) -> None:
    path = tmp_path_factory.mktemp('protocol') / 'p.yaml'
    path.write_text(yaml.safe_dump(yaml.safe_load(GOOD) | tree if whole else tree, allow_unicode=True))
    try:
        assert isinstance(read_protocol(path), Protocol)
    except ConfigError as error:
        assert '\n' not in str(error)
