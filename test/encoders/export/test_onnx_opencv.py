"""Graphs that are rewritten for OpenCV 4.6 give the same bits in ONNX Runtime, and have only its operators."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from offradar_ros.encoders.export.onnx_opencv import OPSET, rewrite_for_opencv
from offradar_ros.encoders.pretrained import find_weights


def constant(name: str, value: np.ndarray) -> onnx.NodeProto:
    return helper.make_node('Constant', [], [name], value=numpy_helper.from_array(value))


def graph(*nodes: onnx.NodeProto) -> onnx.ModelProto:
    x = helper.make_tensor_value_info('x', TensorProto.FLOAT, ['N', 2, 6, 5])
    y = helper.make_tensor_value_info('y', TensorProto.FLOAT, ['N', 'a', 'b', 'c'])
    made = helper.make_graph(list(nodes), 'g', [x], [y])
    return helper.make_model(made, opset_imports=[helper.make_opsetid('', OPSET)], ir_version=8)


def run(model: onnx.ModelProto, x: np.ndarray) -> np.ndarray:
    (y,) = onnxruntime.InferenceSession(model.SerializeToString()).run(['y'], {'x': x})
    return np.asarray(y)


CASES = {
    'gather': [
        constant('i', np.array([4, 5, 0, 1, 2, 3, 4, 5, 0])),
        helper.make_node('Gather', ['x', 'i'], ['y'], axis=2),
    ],
    'slice': [
        *(constant(name, np.array([number])) for name, number in (('a', 2), ('b', 2**63 - 1), ('c', 2), ('d', 1))),
        helper.make_node('Slice', ['x', 'a', 'b', 'c', 'd'], ['y']),
    ],
    'product': [
        constant('m', np.random.default_rng(1).normal(size=(3, 6)).astype(np.float32)),
        helper.make_node('MatMul', ['m', 'x'], ['y']),
    ],
    'difference over rows': [
        helper.make_node('ReduceMean', ['x'], ['m'], axes=[2], keepdims=1),
        helper.make_node('Sub', ['x', 'm'], ['y']),
    ],
    'quotient over columns': [
        helper.make_node('ReduceMax', ['x'], ['m'], axes=[3], keepdims=1),
        helper.make_node('Div', ['x', 'm'], ['y']),
    ],
    'elementwise product over columns': [
        helper.make_node('ReduceMax', ['x'], ['m'], axes=[3], keepdims=1),
        helper.make_node('Mul', ['x', 'm'], ['y']),
    ],
}


@pytest.mark.parametrize('nodes', CASES.values(), ids=CASES)
def test_a_rewritten_operator_gives_the_same_bits(nodes: list[onnx.NodeProto]) -> None:
    x = np.random.default_rng(2).normal(size=(3, 2, 6, 5)).astype(np.float32)
    model = graph(*nodes)
    before = run(model, x)
    rewrite_for_opencv(model)
    onnx.checker.check_model(model, full_check=True)
    assert len(model.graph.node) > len(nodes) or nodes is CASES['slice']
    np.testing.assert_array_equal(run(model, x), before)


def test_other_nodes_do_not_change() -> None:
    nodes = [helper.make_node('Sub', ['x', 'x'], ['z']), helper.make_node('Relu', ['z'], ['y'])]
    model = graph(*nodes)
    rewrite_for_opencv(model)
    assert list(model.graph.node) == nodes


def test_the_graph_of_the_package_has_only_operators_of_opencv_4_6() -> None:
    """For machines with a newer OpenCV, on which the graph would run in any case."""
    model = onnx.load(find_weights('compact', ('.onnx',)))
    constants = {node.output[0] for node in model.graph.node if node.op_type == 'Constant'}
    values = {n.output[0]: numpy_helper.to_array(n.attribute[0].t) for n in model.graph.node if n.op_type == 'Constant'}
    assert model.opset_import[0].version == OPSET
    for node in model.graph.node:
        assert node.op_type != 'Gather'
        if node.op_type == 'Slice':
            start, end = (int(values[name][0]) for name in node.input[1:3])
            assert start < end < 2**31
        if node.op_type == 'MatMul':
            assert node.input[0] not in constants
        if node.op_type == 'Clip':
            assert len(node.input) == 1
