"""How an index keeps its means: as they are, or rounded to half precision in half the memory.

Half precision has 11 significant bits: a value moves by 2⁻¹¹ of itself at most (2⁻²⁵ where it is below 2⁻¹⁴), so that a
mean x moves by at most 2⁻¹¹ |x|, and a distance by no more than that. Values beyond ±65504 cannot be kept.
Products with a query are for a shortlist: approximate, with a bound on their error.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Products = Callable[[NDArray[Any], Floats], tuple[Floats, float]]

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
        products: matrix (N, d) and query (d,) to their N products, and how far, in units of a row's length, these may
            be off beyond the rounding of d single-precision operations.
    """

    dtype: np.dtype[Any]
    largest: float
    products: Products


def mean_storage(name: str) -> MeanStorage:
    """Of the values that `query.storage` may have."""
    if name == 'float32':
        return MeanStorage(np.dtype(np.float32), float(np.finfo(np.float32).max), _products)
    return MeanStorage(np.dtype(np.float16), float(np.finfo(np.float16).max), _half_products())


def _products(means: NDArray[Any], query: Floats) -> tuple[Floats, float]:
    return means @ query, 0.0


@functools.cache
def _half_products() -> Products:
    """NumKong reads half precision as it is; it is used where it is installed and as precise as it says."""
    # Not installed, without a library that it needs, or of a version with other functions.
    with contextlib.suppress(ImportError, OSError, AttributeError, TypeError):
        products = functools.partial(products_of_halves, importlib.import_module('numkong'))
        if is_precise(products):
            return products
    return products_in_blocks


def products_in_blocks(means: NDArray[Any], query: Floats) -> tuple[Floats, float]:
    """Some rows at a time made single precision."""
    products = np.empty(len(means), np.float32)
    block = np.empty((_BLOCK, means.shape[1]), np.float32)
    for start in range(0, len(means), _BLOCK):
        rows = means[start : start + _BLOCK]
        np.copyto(block[: len(rows)], rows)
        np.matmul(block[: len(rows)], query, out=products[start : start + len(rows)])
    return products, 0.0


def products_of_halves(numkong: Any, means: NDArray[Any], query: Floats) -> tuple[Floats, float]:
    """The query rounded too, after a power of two that brings it into the range of half precision."""
    _, exponent = np.frexp(np.max(np.abs(query)))
    exponent = int(np.clip(exponent, -100, 100))
    half = np.ldexp(query, -exponent).astype(np.float16)
    error = query.astype(np.float64) - np.ldexp(half.astype(np.float64), exponent)
    products = np.asarray(numkong.dots_packed(means, numkong.dots_pack(half[None]))).reshape(-1)
    products *= np.float32(2.0**exponent)
    return products, float(np.linalg.norm(error))


def is_precise(products: Products) -> bool:
    """Whether sums are of single precision, as the bound on the error has it.

    Some processors add halves as halves, or take subnormal ones (below 2⁻¹⁴) for zero.
    """
    rng = np.random.default_rng(0)
    for length, scale in itertools.product((3, 128, 1000), (100.0, 2.0**-16)):
        means = (scale * rng.standard_normal((64, length))).astype(np.float16)
        query = rng.standard_normal(length).astype(np.float16).astype(np.float32)
        found, slack = products(means, query)
        lengths = np.linalg.norm(means.astype(np.float64), axis=1)
        bound = lengths * (length * ROUND_OFF * float(np.linalg.norm(query)) + slack)
        if np.any(np.abs(found - means.astype(np.float64) @ query) > bound):
            return False
    return True
