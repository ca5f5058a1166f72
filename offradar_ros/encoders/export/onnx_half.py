"""Half-precision storage in ONNX: weights are float16 in the file, computation is in float32. Needs onnx."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import numpy_helper


def store_half_precision(model: onnx.ModelProto) -> None:
    """Store each float32 matrix or kernel that is exact in float16 as float16, followed by a Cast.

    Runtimes fold the casts when they load the model, so that outputs do not change by a bit.
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
