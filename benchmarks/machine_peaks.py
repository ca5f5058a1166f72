"""Peak performance of one core of this machine, as lower bounds of costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from measuring import interleaved
from numpy.typing import NDArray

SIDE = 1024
READ_BYTES = 512 * 2**20


def gigaflops() -> float:
    """Single-precision operations per second, in 10⁹, of a product of two matrices; the median."""
    square = np.random.default_rng(0).standard_normal((SIDE, SIDE), dtype=np.float32)
    product = interleaved({'sgemm': lambda: square @ square}, repeats=20)['sgemm']
    return 2.0 * SIDE**3 / product.median_ms / 1e6


def gigabytes_per_s() -> float:
    """Bytes read per second, in 10⁹, of a matrix that is far larger than any cache; the fastest of `readings`."""
    taken = interleaved(readings(np.ones(READ_BYTES // 4, np.float32)), repeats=10)
    return READ_BYTES / min(timing.median_ms for timing in taken.values()) / 1e6


def readings(matrix: NDArray[Any]) -> dict[str, Callable[[], object]]:
    """Functions that read every byte of a matrix once, on one thread; the fastest measures the cost of reading."""
    words = matrix.reshape(-1).view(np.uint64)
    functions: dict[str, Callable[[], object]] = {
        'sum of 64-bit words': words.sum,
        'or of 64-bit words': lambda: np.bitwise_or.reduce(words),
    }
    if matrix.dtype == np.float32:
        flat = matrix.reshape(-1)
        functions['BLAS product with itself'] = lambda: flat @ flat
    return functions
