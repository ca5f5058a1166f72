from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from offradar_ros.encoders.fingerprint import fingerprint

TENSORS = {'a': np.arange(6, dtype=np.float32).reshape(2, 3), 'b': np.ones(2, np.float32)}
SETTINGS = {'d': 3, 'scale': 0.5}


def test_is_sha256_and_independent_of_order_and_memory_layout() -> None:
    first = fingerprint('x', SETTINGS, TENSORS)
    reordered = {'b': TENSORS['b'], 'a': np.asfortranarray(TENSORS['a']).astype('>f4')}
    assert len(first) == 64
    assert int(first, 16) >= 0
    assert fingerprint('x', dict(reversed(SETTINGS.items())), reordered) == first


@pytest.mark.parametrize(
    'other',
    [
        ('y', SETTINGS, TENSORS),
        ('x', {**SETTINGS, 'scale': 0.25}, TENSORS),
        ('x', {'d': 3}, TENSORS),
        ('x', {'d': 3, 'scale': '0.5'}, TENSORS),
        ('x', SETTINGS, {}),
        ('x', SETTINGS, {'a': TENSORS['a']}),
        ('x', SETTINGS, {'a': TENSORS['a'], 'c': TENSORS['b']}),
        ('x', SETTINGS, {**TENSORS, 'a': TENSORS['a'].reshape(3, 2)}),
        ('x', SETTINGS, {**TENSORS, 'a': TENSORS['a'].view(np.int32)}),
        ('x', SETTINGS, {**TENSORS, 'a': np.nextafter(TENSORS['a'], 9, dtype=np.float32)}),
    ],
)
def test_every_part_changes_the_fingerprint(other: tuple[str, dict[str, Any], dict[str, Any]]) -> None:
    assert fingerprint(*other) != fingerprint('x', SETTINGS, TENSORS)


def test_scalar_tensors_change_the_fingerprint() -> None:
    one, two = (fingerprint('x', {}, {'n': np.array(value)}) for value in (1, 2))
    assert one != two


def test_does_not_change_between_releases() -> None:
    # Maps on disk store fingerprints: with another value here, all of them would be of another model.
    assert fingerprint('x', SETTINGS, TENSORS) == 'e2e3c61e48d6a2a604ba624654fd9725803b9973e761057fb8a1b10da4a5ce6a'


def test_settings_without_a_canonical_text_are_refused() -> None:
    with pytest.raises(ValueError, match='not JSON compliant'):
        fingerprint('x', {'scale': float('nan')})
