"""Static quantisation of an ONNX network to 8-bit integers. Needs onnx and onnxruntime."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import numpy_helper
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.shape_inference import quant_pre_process

METHODS = {
    'minmax': CalibrationMethod.MinMax,
    'percentile': CalibrationMethod.Percentile,
    'entropy': CalibrationMethod.Entropy,
}
"""Methods for the range of an activation; `benchmarks/smaller_networks.py` compares them."""

# Other operators stay in single precision: normalisation of the image, spectra, L2 normalisation and exponentials.
QUANTISED = ('Conv', 'Relu', 'MaxPool', 'Gemm')


def quantise(model: onnx.ModelProto, images: NDArray[np.uint8], method: str = 'minmax') -> onnx.ModelProto:
    """The quantised network, with ranges from `images` (N, H, W) uint8; inputs, outputs and dynamic N stay.

    Weights are signed with a scale for each channel; activations are unsigned with a scale for each tensor. The heads
    are quantised too: they hold most of VGG-16's weights, and neither recall nor the order of U gets worse.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        prepared, quantised = Path(folder) / 'prepared.onnx', Path(folder) / 'quantised.onnx'
        # Folds batch normalisation and constants; without symbolic shapes it needs no further package.
        quant_pre_process(model, str(prepared), skip_symbolic_shape=True)
        quantize_static(
            str(prepared),
            str(quantised),
            _Reader(images),
            calibrate_method=METHODS[method],
            op_types_to_quantize=list(QUANTISED),
            per_channel=True,
            # 7 bits for each weight: with 8, sums saturate on processors without VNNI, and embeddings of a scan would
            # differ between machines.
            reduce_range=True,
            weight_type=QuantType.QInt8,
            activation_type=QuantType.QUInt8,
            # One scan at a time, so that its activations are freed before the next.
            extra_options={'CalibStridedMinMax': 1},
        )
        return onnx.load(quantised)


def tensors_of(model: onnx.ModelProto) -> dict[str, NDArray[np.generic]]:
    """The constant tensors of a graph by name, including scales and zero points."""
    return {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}


class _Reader(CalibrationDataReader):  # type: ignore[misc]
    """Yields images in batches of one, within the bounds of `set_range`."""

    def __init__(self, images: NDArray[np.uint8]) -> None:
        self._images = images
        self._left: Iterator[int] = iter(())

    def __len__(self) -> int:
        return len(self._images)

    def set_range(self, start_index: int, end_index: int) -> None:
        self._left = iter(range(start_index, end_index))

    def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
        index = next(self._left, None)
        return None if index is None else {'images': self._images[index : index + 1]}
