"""An array in an NPY file with a digest after it, which readers of NPY ignore."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import read_bounded
from offradar_ros.whole_file import write_whole_file

_DIGEST_BYTES = 32
_LARGEST = 16 * 1024**3


def write_array(path: Path, array: NDArray[Any]) -> None:
    """Write an array whole or not at all; OSError if it cannot be written."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    content = file.getvalue()
    write_whole_file(path, content + hashlib.sha256(content).digest())


def read_array(path: Path) -> NDArray[Any]:
    """The array in a file of `write_array`, or in one of an earlier version, without a digest.

    OSError if it cannot be read, ValueError if it is damaged.
    """
    content = memoryview(read_bounded(path, _LARGEST))
    inner = content[:-_DIGEST_BYTES]
    is_whole = hashlib.sha256(inner).digest() == content[-_DIGEST_BYTES:]
    file = io.BytesIO(inner if is_whole else content)
    try:
        array: NDArray[Any] = np.load(file, allow_pickle=False)
    except Exception as error:  # a damaged header is any error of its parser, or of memory that it claims
        raise ValueError(f'no array ({type(error).__name__})') from error
    if file.read(1):
        raise ValueError('damaged: its content is not that of its digest')
    return array


def map_array(path: Path) -> NDArray[Any]:
    """The array in an NPY file without reading it into memory; OSError or ValueError as `read_array`.

    Its values are not checked: they may be more than can be read each time.
    """
    try:
        array: NDArray[Any] = np.load(path, mmap_mode='r', allow_pickle=False)
    except (OSError, ValueError):
        raise
    except Exception as error:  # as above
        raise ValueError(f'no array ({type(error).__name__})') from error
    return array
