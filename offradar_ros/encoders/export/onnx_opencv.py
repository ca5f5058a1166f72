"""Rewrites an ONNX graph with operators that OpenCV 4.6 (Ubuntu 24.04) supports. Needs onnx.

Each rule copies values or multiplies them by 1, so that ONNX Runtime gives the same bits as before:

- a gather of rows becomes a concatenation of slices;
- a slice to the end of an axis gets the index of that end;
- a product with a constant on the left becomes a product of the transposed, C X = (Xᵀ Cᵀ)ᵀ;
- in a difference, quotient or product, a second operand of length 1 along one of the last two axes is repeated to full
  length, by a product with ones.

Up to opset 10 the bounds of ``Clip`` are attributes, the only form that OpenCV 4.6 reads.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

OPSET = 10
"""The opset that graphs for OpenCV 4.6 are exported with."""


def rewrite_for_opencv(model: onnx.ModelProto) -> None:
    """Rewrite the graph in place; its inputs, outputs and initialisers stay."""
    graph = model.graph
    rewriting = _Rewriting(model)
    for node in list(graph.node):
        rewriting.take(node)
    used = {name for node in rewriting.nodes for name in node.input} | {output.name for output in graph.output}
    del graph.node[:]
    graph.node.extend(node for node in rewriting.nodes if used & set(node.output))


class _Rewriting:
    """The rewritten nodes so far, and shapes and constants of values by name."""

    def __init__(self, model: onnx.ModelProto) -> None:
        inferred = onnx.shape_inference.infer_shapes(model).graph
        values = (*inferred.value_info, *inferred.input, *inferred.output)
        # 0 for the number of images, which is dynamic.
        self._shapes = {v.name: [dim.dim_value for dim in v.type.tensor_type.shape.dim] for v in values}
        self._constants = {
            node.output[0]: numpy_helper.to_array(node.attribute[0].t)
            for node in model.graph.node
            if node.op_type == 'Constant'
        }
        self.nodes: list[onnx.NodeProto] = []

    def take(self, node: onnx.NodeProto) -> None:
        """Add the node, or the nodes that replace it."""
        inputs = list(node.input)
        if node.op_type == 'Gather' and self._constants.get(inputs[1], np.array(0)).ndim == 1:
            self._gather(node, node.attribute[0].i)
        elif node.op_type == 'Slice' and len(inputs) > 3:
            self._slice(node)
        elif node.op_type == 'MatMul' and inputs[0] in self._constants:
            self._product(node)
        elif node.op_type in ('Sub', 'Div', 'Mul') and self._axis_to_spread(*inputs) is not None:
            self._spread(node)
        else:
            self.nodes.append(node)

    def _add(self, op_type: str, inputs: list[str], output: str, **attributes: Any) -> str:
        self.nodes.append(helper.make_node(op_type, inputs, [output], name=output, **attributes))
        return output

    def _constant(self, name: str, value: NDArray[np.generic]) -> str:
        self.nodes.append(helper.make_node('Constant', [], [name], name=name, value=numpy_helper.from_array(value)))
        return name

    def _gather(self, node: onnx.NodeProto, axis: int) -> None:
        indices = self._constants[node.input[1]]
        parts: list[str] = []
        # Within a run of consecutive indices, index minus position is constant.
        for _, run in itertools.groupby(enumerate(indices.tolist()), lambda pair: pair[1] - pair[0]):
            rows = [index for _, index in run]
            parts.append(self._part(node.input[0], f'{node.output[0]}/{len(parts)}', rows[0], rows[-1] + 1, axis))
        self._add('Concat', parts, node.output[0], axis=axis)

    def _part(self, value: str, output: str, start: int, end: int, axis: int) -> str:
        bounds = [
            self._constant(f'{output}/{name}', np.array([number], np.int64))
            for name, number in (('start', start), ('end', end), ('axis', axis))
        ]
        return self._add('Slice', [value, *bounds], output)

    def _slice(self, node: onnx.NodeProto) -> None:
        value, *given = node.input
        starts, ends, axes = (self._constants[name] for name in given[:3])
        lengths = np.array([self._shapes[value][axis] for axis in axes])
        clipped = np.where(lengths > 0, np.minimum(ends, lengths), ends)
        bounds = [
            self._constant(f'{node.output[0]}/{name}', numbers.astype(np.int64))
            for name, numbers in (('start', starts), ('end', clipped), ('axis', axes))
        ]
        self._add('Slice', [value, *bounds, *given[3:]], node.output[0])

    def _product(self, node: onnx.NodeProto) -> None:
        left, value = node.input
        output = node.output[0]
        right = self._constant(f'{output}/transposed', np.ascontiguousarray(self._constants[left].T))
        product = self._add('MatMul', [self._transposed(value, value, f'{output}/input'), right], f'{output}/product')
        self._transposed(product, value, output)

    def _transposed(self, value: str, like: str, output: str) -> str:
        """`value`, with as many axes as `like`, with the last two axes transposed."""
        *rest, rows, columns = range(len(self._shapes[like]))
        return self._add('Transpose', [value], output, perm=[*rest, columns, rows])

    def _axis_to_spread(self, first: str, second: str) -> int | None:
        """The axis (-1 or -2) where `second` has length 1 and `first` more, if both are variables and else equal."""
        longer, shorter = self._shapes.get(first), self._shapes.get(second)
        if not longer or not shorter or len(longer) != len(shorter) or {first, second} & self._constants.keys():
            return None
        different = [k - len(longer) for k in range(len(longer)) if longer[k] != shorter[k]]
        one = len(different) == 1 and different[0] in (-1, -2) and shorter[different[0]] == 1
        return different[0] if one else None

    def _spread(self, node: onnx.NodeProto) -> None:
        first, second = node.input
        axis = self._axis_to_spread(first, second)
        assert axis is not None
        output = node.output[0]
        ones = self._constant(f'{output}/ones', np.ones((1, self._shapes[first][axis]), np.float32))
        if axis == -1:
            spread = self._add('MatMul', [second, ones], f'{output}/spread')
        else:
            turned = self._transposed(second, second, f'{output}/turned')
            product = self._add('MatMul', [turned, ones], f'{output}/product')
            spread = self._transposed(product, second, f'{output}/spread')
        self._add(node.op_type, [first, spread], output)
