"""How an index keeps its means: as they are, or rounded to half precision in half the memory.

Half precision has 11 significant bits: a value moves by 2⁻¹¹ of itself at most (2⁻²⁵ where it is below 2⁻¹⁴), so that a
mean x moves by at most 2⁻¹¹ |x|, and a distance by no more than that. Values beyond ±65504 cannot be kept.
Scores, which rank means x by how near they are to a query q, are |x|² − 2 x·q: sums of d + 1 terms in single
precision, in any order, for a shortlist.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Scores = Callable[[NDArray[Any], Floats, Floats], Floats]

ROUND_OFF = 2.0**-24
"""Relative error of one single-precision operation."""

_BLOCK = 1024
"""Rows converted at once: they stay in the processor's cache."""


@dataclasses.dataclass(frozen=True)
class MeanStorage:
    """One way of keeping means.

    Attributes:
        dtype: of the matrix.
        largest: no value may exceed this.
        scores: means (N, d), query (d,) and the means' squared lengths (N,) to their scores (N,).
    """

    dtype: np.dtype[Any]
    largest: float
    scores: Scores


def mean_storage(name: str) -> MeanStorage:
    """Of the values that `query.storage` may have."""
    if name == 'float32':
        return MeanStorage(np.dtype(np.float32), float(np.finfo(np.float32).max), _scores)
    return MeanStorage(np.dtype(np.float16), float(np.finfo(np.float16).max), _half_scores())


def _scores(means: NDArray[Any], query: Floats, squares: Floats) -> Floats:
    scores: Floats = means @ (np.float32(-2.0) * query)
    scores += squares
    return scores


def widens_halves_quickly() -> bool:
    """Whether `float16` is searched at the speed of memory: without llvmlite it takes several times as long."""
    return _half_scores() is not scores_in_blocks


@functools.cache
def _half_scores() -> Scores:
    """Compiled by LLVM, where llvmlite is installed and as precise as it should be."""
    # Not installed, without a library that it needs, or of a version with other functions.
    with contextlib.suppress(ImportError, OSError, AttributeError, TypeError, RuntimeError):
        from offradar_ros.retrieval.half_scores import scores_of_halves  # noqa: PLC0415

        if is_precise(scores_of_halves):
            return scores_of_halves
    return scores_in_blocks


def scores_in_blocks(means: NDArray[Any], query: Floats, squares: Floats) -> Floats:
    """Some rows at a time made single precision."""
    scores = np.empty(len(means), np.float32)
    block = np.empty((_BLOCK, means.shape[1]), np.float32)
    factor = np.float32(-2.0) * query
    for start in range(0, len(means), _BLOCK):
        rows = means[start : start + _BLOCK]
        np.copyto(block[: len(rows)], rows)
        np.matmul(block[: len(rows)], factor, out=scores[start : start + len(rows)])
    scores += squares
    return scores


def is_precise(scores: Scores) -> bool:
    """Whether sums are of single precision, as the bound on the error has it.

    Some processors add halves as halves, or take subnormal ones (below 2⁻¹⁴) for zero.
    """
    rng = np.random.default_rng(0)
    for length, scale in itertools.product((3, 128, 1000), (100.0, 2.0**-16)):
        means = (scale * rng.standard_normal((64, length))).astype(np.float16)
        query = rng.standard_normal(length).astype(np.float32)
        wide = means.astype(np.float64)
        bound = 2.0 * length * ROUND_OFF * np.linalg.norm(wide, axis=1) * float(np.linalg.norm(query))
        if np.any(np.abs(scores(means, query, np.zeros(64, np.float32)) + 2.0 * wide @ query) > bound):
            return False
    return True
