"""Damage that a reader does not notice is counted as a difference, and what is read is compared to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from faults.content_digest import content_digest
from faults.flipped_files import damage, flip
from faults.result import Settings

from offradar_ros.errors import DataError
from offradar_ros.types import Pose


def test_a_reader_that_notices_nothing_is_found_out(tmp_path: Path) -> None:
    sound = tmp_path / 'sound.txt'
    sound.write_bytes(bytes(range(256)) * 4)
    result = flip(Settings(tmp_path, scale=0.1), 'text', sound, lambda path: path.read_bytes().hex(), 0)
    assert result.differences > 0.8 * result.tries


def test_a_reader_that_refuses_or_ignores_passes(tmp_path: Path) -> None:
    sound = tmp_path / 'sound.txt'
    sound.write_bytes(b'x' * 1000)

    def read(path: Path) -> str:
        if path.read_bytes() != b'x' * 1000:
            raise DataError(f'{path}: damaged')
        return 'content'

    result = flip(Settings(tmp_path, scale=0.1), 'text', sound, read, 0)
    assert (result.failures, result.refused + result.same) == (0, result.tries)
    assert result.refused


def test_damage_is_the_same_for_a_seed_and_never_nothing_for_a_bit() -> None:
    content = bytes(1000)
    for seed in range(50):
        once, again = (damage(content, np.random.default_rng(seed)) for _ in range(2))
        assert once == again
        if once[1].startswith('bit'):
            assert once[0] != content


def test_a_digest_tells_every_value_apart() -> None:
    values = [
        Pose(1.0, 2.0),
        Pose(1.0, 2.0, 0.0, 0.0),
        np.zeros(2),
        np.zeros(2, np.float32),
        np.zeros((2, 1)),
        -0.0,
        0.0,
        0,
        False,
        None,
        '',
        b'',
        [],
        [[]],
        {},
        {'a': 1},
    ]
    assert len({content_digest(value) for value in values}) == len(values)
