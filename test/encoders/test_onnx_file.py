"""Our reader of ONNX files against the onnx package."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.encoders.onnx_file import has_external_data, in_single_precision, metadata_entry, read_metadata
from offradar_ros.encoders.pretrained import find_weights

pytest.importorskip('onnx')

import onnx

COMPACT = find_weights('compact', ('.onnx',))


def test_metadata_equals_that_of_the_onnx_package() -> None:
    assert read_metadata(COMPACT.read_bytes()) == {
        entry.key: entry.value for entry in onnx.load(COMPACT).metadata_props
    }


def test_half_precision_weights_are_converted_and_nothing_else_changes() -> None:
    before = onnx.load(COMPACT)
    after = onnx.load_from_string(in_single_precision(COMPACT.read_bytes()))
    onnx.checker.check_model(after, full_check=True)
    halves = 0
    for one, two in zip(before.graph.initializer, after.graph.initializer, strict=True):
        tensor = onnx.numpy_helper.to_array(one)
        halves += tensor.dtype == np.float16
        expected = tensor.astype(np.float32) if tensor.dtype == np.float16 else tensor
        assert (one.name, list(one.dims)) == (two.name, list(two.dims))
        np.testing.assert_array_equal(onnx.numpy_helper.to_array(two), expected, strict=True)
    assert halves > 3
    for model in (before, after):
        del model.graph.initializer[:]
    assert before == after


def test_an_entry_is_added_by_appending_it() -> None:
    content = COMPACT.read_bytes() + metadata_entry('one.more', 'of two words')
    assert read_metadata(content)['one.more'] == 'of two words'
    found = {entry.key: entry.value for entry in onnx.load_from_string(content).metadata_props}
    assert found == read_metadata(content)


def outside() -> onnx.TensorProto:
    tensor = onnx.helper.make_tensor('outside', onnx.TensorProto.FLOAT, [1], [0.0])
    tensor.ClearField('float_data')
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key='location', value='/etc/hostname')
    return tensor


def within_a_graph(tensor: onnx.TensorProto) -> onnx.GraphProto:
    return onnx.GraphProto(initializer=[tensor])


def without(tensor: onnx.TensorProto, field: str) -> onnx.TensorProto:
    tensor.ClearField(field)
    return tensor


def sparse(**parts: onnx.TensorProto) -> onnx.SparseTensorProto:
    return onnx.SparseTensorProto(**parts)


def in_an_attribute(attribute: onnx.AttributeProto) -> onnx.ModelProto:
    return onnx.ModelProto(graph=onnx.GraphProto(node=[onnx.NodeProto(attribute=[attribute])]))


PLACES = {
    'initialiser': lambda: onnx.ModelProto(graph=within_a_graph(outside())),
    'constant': lambda: onnx.ModelProto(
        graph=onnx.GraphProto(node=[onnx.NodeProto(attribute=[onnx.AttributeProto(t=outside())])])
    ),
    'list of constants': lambda: onnx.ModelProto(
        graph=onnx.GraphProto(node=[onnx.NodeProto(attribute=[onnx.AttributeProto(tensors=[outside()])])])
    ),
    'branch': lambda: onnx.ModelProto(
        graph=onnx.GraphProto(
            node=[onnx.NodeProto(attribute=[onnx.AttributeProto(g=within_a_graph(outside()))])],
        )
    ),
    'sparse': lambda: onnx.ModelProto(
        graph=onnx.GraphProto(sparse_initializer=[onnx.SparseTensorProto(values=outside())])
    ),
    'function': lambda: onnx.ModelProto(
        functions=[
            onnx.FunctionProto(
                node=[onnx.NodeProto(attribute=[onnx.AttributeProto(graphs=[within_a_graph(outside())])])]
            )
        ]
    ),
    'default of a function': lambda: onnx.ModelProto(
        functions=[onnx.FunctionProto(attribute_proto=[onnx.AttributeProto(t=outside())])]
    ),
    'sparse constant': lambda: in_an_attribute(onnx.AttributeProto(sparse_tensor=sparse(values=outside()))),
    'sparse constants': lambda: in_an_attribute(onnx.AttributeProto(sparse_tensors=[sparse(values=outside())])),
    'places of sparse values': lambda: in_an_attribute(onnx.AttributeProto(sparse_tensor=sparse(indices=outside()))),
    'training step': lambda: onnx.ModelProto(
        training_info=[onnx.TrainingInfoProto(algorithm=within_a_graph(outside()))]
    ),
    'no location': lambda: onnx.ModelProto(graph=within_a_graph(without(outside(), 'data_location'))),
    'no path': lambda: onnx.ModelProto(graph=within_a_graph(without(outside(), 'external_data'))),
    'training': lambda: onnx.ModelProto(
        training_info=[onnx.TrainingInfoProto(initialization=within_a_graph(outside()))]
    ),
}


@pytest.mark.parametrize('place', PLACES)
def test_a_tensor_in_another_file_is_found_wherever_it_is(place: str) -> None:
    model = PLACES[place]()
    assert has_external_data(model.SerializeToString())
    assert not has_external_data(COMPACT.read_bytes())


def test_a_tensor_that_says_that_it_is_in_the_file_is_there() -> None:
    tensor = onnx.helper.make_tensor('inside', onnx.TensorProto.FLOAT, [1], [0.0])
    tensor.data_location = onnx.TensorProto.DEFAULT
    assert not has_external_data(onnx.ModelProto(graph=within_a_graph(tensor)).SerializeToString())


@pytest.mark.parametrize(
    'content',
    [
        onnx.ModelProto(metadata_props=[onnx.StringStringEntryProto(key='a')]).SerializeToString(),
        onnx.ModelProto(metadata_props=[onnx.StringStringEntryProto(value='a')]).SerializeToString(),
        onnx.ModelProto(producer_name='somebody').SerializeToString()[:-1],
        b'\x08' + b'\x80' * 20 + b'\x01',
    ],
    ids=['no value', 'no key', 'cut off', 'a number of 140 bits'],
)
def test_what_is_no_onnx_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match=r'without key or value|not a protocol buffer, or truncated'):
        read_metadata(content)


def test_graphs_nested_without_end_are_refused() -> None:
    graph = onnx.GraphProto()
    for _ in range(15):
        graph = onnx.GraphProto(node=[onnx.NodeProto(attribute=[onnx.AttributeProto(g=graph)])])
    with pytest.raises(ValueError, match='graphs within graphs'):
        has_external_data(onnx.ModelProto(graph=graph).SerializeToString())


@settings(max_examples=100, deadline=None)
@given(st.one_of(st.binary(max_size=200), st.integers(0, 20_000)))
def test_damaged_content_is_read_or_refused(damage: bytes | int) -> None:
    content = damage if isinstance(damage, bytes) else COMPACT.read_bytes()[-damage:]
    for read in (read_metadata, in_single_precision, has_external_data):
        with contextlib.suppress(ValueError):
            read(content)
