"""A model is checked before anything is made of what it says about itself."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from offradar_ros.encoders.protocol import (
    MAX_DIMENSION,
    MAX_METADATA_CHARACTERS,
    MAX_METADATA_ENTRIES,
    MAX_NAME_CHARACTERS,
    ModelInfo,
)
from offradar_ros.errors import ConfigError, ModelError
from offradar_ros.records import structure, unstructure

MODEL = ModelInfo('ring_key', 'ab' * 32, 128, {'rings': '128', 'note': 'ü 𝕊'})

INVALID: list[tuple[dict[str, Any], str]] = [
    ({'name': ''}, 'a printable name'),
    ({'name': 'x' * (MAX_NAME_CHARACTERS + 1)}, 'a printable name'),
    ({'name': 'ring\nkey'}, 'a printable name'),
    ({'name': 'ring\ud800key'}, 'a printable name'),
    ({'fingerprint': ''}, '64 lower-case hex digits'),
    ({'fingerprint': 'ab' * 31}, '64 lower-case hex digits'),
    ({'fingerprint': 'AB' * 32}, '64 lower-case hex digits'),
    ({'fingerprint': 'ab' * 31 + 'g0'}, '64 lower-case hex digits'),
    ({'fingerprint': 'ab' * 32 + '\n'}, '64 lower-case hex digits'),
    ({'fingerprint': '٣' * 64}, '64 lower-case hex digits'),
    ({'dimension': 0}, f'a dimension of 1 to {MAX_DIMENSION}'),
    ({'dimension': -1}, f'a dimension of 1 to {MAX_DIMENSION}'),
    ({'dimension': MAX_DIMENSION + 1}, f'a dimension of 1 to {MAX_DIMENSION}'),
    ({'dimension': 10**12}, f'a dimension of 1 to {MAX_DIMENSION}'),
    ({'dimension': True}, f'a dimension of 1 to {MAX_DIMENSION}'),
    ({'dimension': 128.0}, f'a dimension of 1 to {MAX_DIMENSION}'),
    ({'metadata': {str(i): '' for i in range(MAX_METADATA_ENTRIES + 1)}}, 'entries of metadata'),
    ({'metadata': {'a': 'x' * MAX_METADATA_CHARACTERS}}, 'metadata of valid text'),
    ({'metadata': {'x' * MAX_METADATA_CHARACTERS: 'a'}}, 'metadata of valid text'),
    ({'metadata': {'a': '\ud800'}}, 'metadata of valid text'),
    ({'metadata': {'a': 1}}, 'metadata of valid text'),
    ({'metadata': {'a': {}}}, 'metadata of valid text'),
]


@pytest.mark.parametrize(('changes', 'message'), INVALID)
def test_a_model_outside_the_bounds_is_refused_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message) as refusal:
        dataclasses.replace(MODEL, **changes)
    assert len(str(refusal.value).splitlines()) == 1
    assert len(str(refusal.value)) < 300


@pytest.mark.parametrize(
    ('changes', 'message'), [case for case in INVALID if type(case[0].get('dimension')) not in {bool, float}]
)
def test_a_file_with_such_a_model_is_refused_too(changes: dict[str, Any], message: str) -> None:
    tree = unstructure(MODEL) | changes
    with pytest.raises(ConfigError, match=f'{message}|expected text'):
        structure(ModelInfo, tree)


def test_the_largest_model_is_valid() -> None:
    largest = ModelInfo('x' * MAX_NAME_CHARACTERS, '0f' * 32, MAX_DIMENSION, {'': 'x' * MAX_METADATA_CHARACTERS})
    assert structure(ModelInfo, unstructure(largest)) == largest


def test_name_and_metadata_do_not_make_another_model() -> None:
    assert MODEL.is_same_model(dataclasses.replace(MODEL, name='other', metadata={}))
    assert not MODEL.is_same_model(dataclasses.replace(MODEL, dimension=129))
    assert not MODEL.is_same_model(dataclasses.replace(MODEL, fingerprint='cd' * 32))
