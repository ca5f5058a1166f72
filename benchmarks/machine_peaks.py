"""What this machine could do at best: the floors that costs are drawn against."""

from __future__ import annotations

import numpy as np
from measuring import interleaved

SIDE = 3072
READ_BYTES = 512 * 2**20


def gigaflops() -> float:
    """Single-precision products and sums a second, 10⁹, of a large matrix product on all cores."""
    rng = np.random.default_rng(0)
    a, b = (rng.standard_normal((SIDE, SIDE), dtype=np.float32) for _ in range(2))
    made = np.empty((SIDE, SIDE), np.float32)
    best_ms = interleaved({'product': lambda: np.matmul(a, b, out=made)}, repeats=5, warm_up=2)['product'].quartiles_ms[
        0
    ]
    return 2.0 * SIDE**3 / best_ms / 1e6


def gigabytes_per_s() -> float:
    """Bytes read from memory a second, 10⁹, by one core that sums a matrix far larger than any cache."""
    matrix = np.ones(READ_BYTES // 4, np.float32)
    best_ms = interleaved({'sum': matrix.sum}, repeats=5, warm_up=2)['sum'].quartiles_ms[0]
    return READ_BYTES / best_ms / 1e6
