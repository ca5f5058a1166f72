"""Our reader of ONNX files against the onnx package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from offradar_ros.encoders.onnx_file import read_in_single_precision, read_metadata
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.errors import ModelError

pytest.importorskip('onnx')

import onnx

COMPACT = find_weights('compact', ('.onnx',))


def test_metadata_equals_that_of_the_onnx_package() -> None:
    assert read_metadata(COMPACT) == {entry.key: entry.value for entry in onnx.load(COMPACT).metadata_props}


def test_half_precision_weights_are_converted_and_nothing_else_changes(tmp_path: Path) -> None:
    before = onnx.load(COMPACT)
    after = onnx.load_from_string(read_in_single_precision(COMPACT))
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


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match='none: no such weights file'):
        read_metadata(tmp_path / 'none')


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.one_of(st.binary(max_size=200), st.integers(0, 20_000)))
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path: Path, damage: bytes | int) -> None:
    path = tmp_path / 'damaged.onnx'
    path.write_bytes(damage if isinstance(damage, bytes) else COMPACT.read_bytes()[-damage:])
    for read in (read_metadata, read_in_single_precision):
        try:
            read(path)
        except ModelError as error:
            assert str(error).startswith(f'{path}: ')
            assert '\n' not in str(error)
