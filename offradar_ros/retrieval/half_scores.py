"""Scores of half-precision rows, compiled by LLVM: rows are widened in registers, as fast as memory gives them.

NumPy, BLAS and OpenCV widen halves in memory, which takes several times as long. Importing this compiles it.
"""

from __future__ import annotations

import ctypes
import platform
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numpy.typing import NDArray

_MULTIPLY = """
declare void @llvm.prefetch.p0(ptr, i32, i32, i32)
declare <32 x float> @llvm.fmuladd.v32f32(<32 x float>, <32 x float>, <32 x float>)
declare float @llvm.vector.reduce.fadd.v32f32(float, <32 x float>)

define void @multiply(ptr %means, ptr %factor, ptr %products, i64 %rows, i64 %dimension) {
start:
  %whole = and i64 %dimension, -32
  %none = icmp eq i64 %rows, 0
  br i1 %none, label %done, label %row

row:
  %r = phi i64 [0, %start], [%r.next, %row.end]
  %mean = phi ptr [%means, %start], [%mean.next, %row.end]
  %no.line = icmp eq i64 %whole, 0
  br i1 %no.line, label %line.end, label %line

line:  ; 32 halves are the 64 bytes that memory gives at once
  %i = phi i64 [0, %row], [%i.next, %line]
  %sums = phi <32 x float> [zeroinitializer, %row], [%sums.next, %line]
  %halves.at = getelementptr half, ptr %mean, i64 %i
  %factors.at = getelementptr float, ptr %factor, i64 %i
  ; to be read, kept in every cache, data; beyond the last row is no harm
  %ahead = getelementptr i8, ptr %halves.at, i64 1536
  call void @llvm.prefetch.p0(ptr %ahead, i32 0, i32 3, i32 1)
  %halves = load <32 x half>, ptr %halves.at, align 2
  %factors = load <32 x float>, ptr %factors.at, align 4
  %wide = fpext <32 x half> %halves to <32 x float>
  %sums.next = call <32 x float> @llvm.fmuladd.v32f32(<32 x float> %wide, <32 x float> %factors, <32 x float> %sums)
  %i.next = add i64 %i, 32
  %more.lines = icmp ult i64 %i.next, %whole
  br i1 %more.lines, label %line, label %line.end

line.end:
  %all = phi <32 x float> [zeroinitializer, %row], [%sums.next, %line]
  %sum = call reassoc float @llvm.vector.reduce.fadd.v32f32(float 0.0, <32 x float> %all)
  %no.rest = icmp eq i64 %whole, %dimension
  br i1 %no.rest, label %row.end, label %rest

rest:
  %j = phi i64 [%whole, %line.end], [%j.next, %rest]
  %total = phi float [%sum, %line.end], [%total.next, %rest]
  %half.at = getelementptr half, ptr %mean, i64 %j
  %factor.at = getelementptr float, ptr %factor, i64 %j
  %one = load half, ptr %half.at, align 2
  %by = load float, ptr %factor.at, align 4
  %one.wide = fpext half %one to float
  %product = fmul float %one.wide, %by
  %total.next = fadd float %total, %product
  %j.next = add i64 %j, 1
  %more = icmp ult i64 %j.next, %dimension
  br i1 %more, label %rest, label %row.end

row.end:
  %result = phi float [%sum, %line.end], [%total.next, %rest]
  %product.at = getelementptr float, ptr %products, i64 %r
  store float %result, ptr %product.at, align 4
  %r.next = add i64 %r, 1
  %mean.next = getelementptr half, ptr %mean, i64 %dimension
  %more.rows = icmp ult i64 %r.next, %rows
  br i1 %more.rows, label %row, label %done

done:
  ret void
}
"""
"""Products of float16 means (rows, dimension) and a float32 factor (dimension,). Memory is asked for them
ahead, since the processor's own guess comes too late for rows this short."""


def _compiled() -> llvm.ExecutionEngine:
    features = llvm.get_host_cpu_features()
    # Without such an instruction a library is called that is not there.
    if platform.machine() != 'aarch64' and not features.get('f16c'):
        raise ImportError('this processor has no instruction that widens halves')
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple()
    machine = target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features.flatten(), opt=3)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(_MULTIPLY), machine)
    engine.finalize_object()
    return engine


_engine = _compiled()
_multiply = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, *[ctypes.c_int64] * 2)(
    _engine.get_function_address('multiply')
)


def scores_of_halves(
    means: NDArray[Any], query: NDArray[np.float32], squares: NDArray[np.float32]
) -> NDArray[np.float32]:
    """As `MeanStorage.scores` has it, of float16 means."""
    rows, dimension = means.shape
    means = np.ascontiguousarray(means, np.float16)
    factor = np.ascontiguousarray(np.float32(-2.0) * query.reshape(dimension), np.float32)
    scores = np.empty(rows, np.float32)
    _multiply(means.ctypes.data, factor.ctypes.data, scores.ctypes.data, rows, dimension)
    # Not in the loop above, which a second array to read slows down more than this takes.
    scores += squares
    return scores
