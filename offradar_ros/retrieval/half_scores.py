"""Scores of half-precision rows, compiled by Numba: rows are widened in registers, as fast as memory gives them.

Importing this compiles it, which takes half a second.
"""

from __future__ import annotations

import platform
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic
from numpy.typing import NDArray

_AHEAD = 1536
"""So many bytes ahead memory is asked for: the processor's own guess comes too late for rows this short."""

_LINE = 64
"""Bytes that memory gives at once."""


def _widens() -> bool:
    """Whether code for this processor has an instruction that widens halves: without one, calling it is a crash."""
    config = numba.config
    if config.DISABLE_JIT or config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return False
    return platform.machine() == 'aarch64' or bool(llvmlite.binding.get_host_cpu_features().get('f16c'))


if not _widens():
    raise ImportError('no instruction that widens halves')


@intrinsic
def _widened(_: Any, bits: Any) -> tuple[Any, Any]:
    """The float32 that these 16 bits are as a float16."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fpext(builder.bitcast(arguments[0], ir.HalfType()), ir.FloatType())

    return numba.float32(bits), generate


@intrinsic
def _ask_for(_: Any, array: Any, offset: Any) -> tuple[Any, Any]:
    """Have the byte at `offset` from an array's first fetched; none need be there."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        byte, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
        first = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        place = builder.gep(builder.bitcast(first, byte), [arguments[1]])
        kind = ir.FunctionType(ir.VoidType(), [byte, flag, flag, flag])
        prefetch = builder.module.declare_intrinsic('llvm.prefetch', [byte], kind)
        # To be read, kept in every cache, and data.
        builder.call(prefetch, [place, flag(0), flag(3), flag(1)])
        return context.get_dummy_value()

    return numba.void(array, offset), generate


@numba.njit(
    'void(uint16[:, ::1], float32[::1], float32[::1])',
    nogil=True,
    # Sums may be taken in any order, which vectors need; infinities and NaN are what they are.
    fastmath={'reassoc', 'contract', 'nsz'},
)
def _multiply(halves: Any, factor: Any, products: Any) -> None:
    rows, dimension = halves.shape
    for row in range(rows):
        start = 2 * dimension * row + _AHEAD
        for offset in range(start, start + 2 * dimension, _LINE):
            _ask_for(halves, offset)
        total = np.float32(0.0)
        for column in range(dimension):
            total += _widened(halves[row, column]) * factor[column]
        products[row] = total


def scores_of_halves(
    means: NDArray[Any], query: NDArray[np.float32], squares: NDArray[np.float32]
) -> NDArray[np.float32]:
    """As `MeanStorage.scores` has it, of float16 means."""
    scores = np.empty(len(means), np.float32)
    _multiply(means.view(np.uint16), np.float32(-2.0) * query, scores)
    # Not in the loop above, which a second array to read slows down more than this takes.
    scores += squares
    return scores
