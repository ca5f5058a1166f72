"""Arrays of the laboratory's files: whole, or refused."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.array_file import map_array, read_array, write_array

ARRAYS: list[NDArray[Any]] = [
    np.arange(12, dtype=np.float32).reshape(3, 4),
    np.zeros((0, 4)),
    np.array([(1, 2.0)], 'i4,f8'),
]


@pytest.mark.parametrize('array', ARRAYS)
def test_an_array_is_read_as_it_was_written_also_by_numpy(tmp_path: Path, array: NDArray[Any]) -> None:
    path = tmp_path / 'array.npy'
    write_array(path, array)
    np.testing.assert_array_equal(read_array(path), array, strict=True)
    np.testing.assert_array_equal(np.load(path), array, strict=True)


def test_files_of_an_earlier_version_have_no_digest(tmp_path: Path) -> None:
    np.save(tmp_path / 'old.npy', ARRAYS[0])
    np.testing.assert_array_equal(read_array(tmp_path / 'old.npy'), ARRAYS[0])


def test_every_flipped_bit_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / 'array.npy'
    write_array(path, ARRAYS[0])
    content = bytearray(path.read_bytes())
    for at in range(len(content)):
        content[at] ^= 1 << at % 8
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r'damaged|no array'):
            read_array(path)
        with contextlib.suppress(ValueError):
            map_array(path)
        content[at] ^= 1 << at % 8


@pytest.mark.parametrize('shape', [(10**15,), (10**6, 10**6)])
def test_a_header_that_claims_too_much_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    path = tmp_path / 'array.npy'
    with path.open('wb') as file:
        np.lib.format.write_array_header_1_0(file, {'descr': '<f8', 'fortran_order': False, 'shape': shape})
        file.write(b'few')
    for read in (read_array, map_array):
        with pytest.raises(ValueError, match=r'no array|greater than file size|too large|big'):
            read(path)
