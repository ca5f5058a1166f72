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
"""How the range of an activation is found; `benchmarks/smaller_networks.py` compares them."""

# What surrounds them stays in single precision: the image's normalisation, spectra, unit length and exponentials.
QUANTISED = ('Conv', 'Relu', 'MaxPool', 'Gemm')


def quantise(model: onnx.ModelProto, images: NDArray[np.uint8], method: str = 'minmax') -> onnx.ModelProto:
    """The network in integers, its ranges fitted to `images` (N, H, W) uint8; inputs, outputs and free N stay.

    Weights are signed, one scale a channel; activations are unsigned, one scale a tensor. The heads are in integers
    too: they are most of VGG-16's weights, and neither recall nor the order of U suffers.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        prepared, quantised = Path(folder) / 'prepared.onnx', Path(folder) / 'quantised.onnx'
        # Folds batch normalisation and constants, but needs no symbolic shapes, and so no further package.
        quant_pre_process(model, str(prepared), skip_symbolic_shape=True)
        quantize_static(
            str(prepared),
            str(quantised),
            _Reader(images),
            calibrate_method=METHODS[method],
            op_types_to_quantize=list(QUANTISED),
            per_channel=True,
            # 7 bits a weight: with 8, processors that lack VNNI saturate sums that others do not, and a scan would
            # have other embeddings on another machine.
            reduce_range=True,
            weight_type=QuantType.QInt8,
            activation_type=QuantType.QUInt8,
            # One scan at a time, whose activations are then let go.
            extra_options={'CalibStridedMinMax': 1},
        )
        return onnx.load(quantised)


def tensors_of(model: onnx.ModelProto) -> dict[str, NDArray[np.generic]]:
    """Every constant tensor of a graph, scales and zero points among them, by name."""
    return {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}


class _Reader(CalibrationDataReader):  # type: ignore[misc]
    """Hands out images as batches of one, between the bounds of `set_range`."""

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
