"""Half-precision storage in ONNX: the file holds float16, the graph computes in float32. Needs onnx."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import numpy_helper


def store_halves(model: onnx.ModelProto) -> None:
    """Store each float32 matrix or kernel that float16 holds exactly as such, with a Cast in front of its users.

    Runtimes fold the casts when they load the model, so that what is computed does not change by a bit.
    """
    graph = model.graph
    casts: list[onnx.NodeProto] = []
    for initialiser in graph.initializer:
        if initialiser.data_type != onnx.TensorProto.FLOAT or len(initialiser.dims) < 2:
            continue
        tensor = numpy_helper.to_array(initialiser)
        with np.errstate(over='ignore'):
            half = tensor.astype(np.float16)
        if not np.array_equal(half.astype(np.float32), tensor):
            continue
        name, stored = initialiser.name, f'{initialiser.name}.float16'
        initialiser.CopyFrom(numpy_helper.from_array(half, stored))
        casts.append(onnx.helper.make_node('Cast', [stored], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *graph.node]
    del graph.node[:]
    graph.node.extend(nodes)
