"""Writes a weights file as ONNX, for vehicles without torch. Needs torch, safetensors and onnx, when called."""

from __future__ import annotations

import dataclasses
import tempfile
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from offradar_ros.encoders.export.calibration_scans import CalibrationScans
from offradar_ros.encoders.fingerprint import Setting, fingerprint
from offradar_ros.encoders.model_files import require_package, write_atomically
from offradar_ros.encoders.weights_header import WeightsHeader

if TYPE_CHECKING:
    import onnx

    from offradar_ros.encoders.networks.network import Network

INT8_OPSET = 17


@dataclasses.dataclass(frozen=True, eq=False)
class Smaller:
    """What makes an exported network cheaper, and another model than its weights, with a fingerprint of its own.

    Attributes:
        scans: what it is fitted to.
        int8: whether it computes with 8-bit integers.
        method: how their ranges are found, a name of `onnx_int8.METHODS`.
        low_rank: share of the convolutions' multiplications that is kept; 1 leaves them as they are.
    """

    scans: CalibrationScans
    int8: bool = False
    method: str = 'minmax'
    low_rank: float = 1.0


def export_onnx(weights_path: str | Path, onnx_path: str | Path, smaller: Smaller | None = None) -> WeightsHeader:
    """Write what `OnnxEncoder` reads; returns the header that the file carries, by default that of the weights.

    Input ``images`` (N, H, W) uint8, so that scaling and normalisation are part of the graph; outputs ``mean`` and
    ``variance`` (N, d) float32; N is free. Weights stored in half precision are stored so here too, and computed with
    in single precision. The same weights and scans give the same file on one machine. The file is written whole or not
    at all. ModelError for weights that cannot be read, a file that cannot be written or a missing package.
    """
    for package in ('torch', 'safetensors', 'onnx', *(('onnxruntime',) if smaller and smaller.int8 else ())):
        require_package(package, weights_path)
    import onnx  # noqa: PLC0415

    from offradar_ros.encoders.export.onnx_half import store_halves  # noqa: PLC0415
    from offradar_ros.encoders.export.onnx_opencv import OPSET, rewrite_for_opencv  # noqa: PLC0415
    from offradar_ros.encoders.networks.files import load_network  # noqa: PLC0415

    network, header = load_network(weights_path)
    if smaller and smaller.low_rank < 1.0:
        header = _factorised(network, header, smaller)
    if smaller and smaller.int8:
        model, header = _quantised(_graph(network, header, INT8_OPSET), header, smaller)
    else:
        model = _graph(network, header, OPSET)
        rewrite_for_opencv(model)
        if header.stored == 'float16':
            store_halves(model)
    for key, value in header.to_metadata().items():
        model.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(model, full_check=True)
    write_atomically(onnx_path, model.SerializeToString(deterministic=True))
    return header


def _graph(network: Network, header: WeightsHeader, opset: int) -> onnx.ModelProto:
    import onnx  # noqa: PLC0415
    import torch  # noqa: PLC0415

    class Inference(torch.nn.Module):
        """The part of the network that a vehicle runs."""

        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return self.network.embed(images)

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), torch.no_grad():
        exported = Path(folder) / 'network.onnx'
        # The exporter that needs no further package is deprecated, and says so at length.
        warnings.simplefilter('ignore')
        torch.onnx.export(
            Inference().eval(),
            (torch.zeros((1, *header.config.image_shape), dtype=torch.uint8),),
            exported,
            dynamo=False,
            opset_version=opset,
            # Batch normalisation stays apart from its convolution, so that the weights are those of the file.
            training=torch.onnx.TrainingMode.PRESERVE,
            input_names=['images'],
            output_names=['mean', 'variance'],
            dynamic_axes={'images': {0: 'N'}, 'mean': {0: 'N'}, 'variance': {0: 'N'}},
        )
        return onnx.load(exported)


def _factorised(network: Network, header: WeightsHeader, smaller: Smaller) -> WeightsHeader:
    """The header of the network that is of low rank afterwards."""
    from offradar_ros.encoders.networks.low_rank import factorise, round_to_halves  # noqa: PLC0415

    factorise(network, smaller.scans.images, smaller.low_rank)
    if header.stored == 'float16':
        round_to_halves(network)
    settings: dict[str, Setting] = {'parent': header.fingerprint, 'share': smaller.low_rank}
    tensors = {name: tensor.detach().numpy() for name, tensor in network.state_dict().items()}
    return _derived(
        header, fingerprint('low_rank', settings, tensors), f'low rank, {smaller.low_rank:g} of', header.stored, smaller
    )


def _quantised(
    model: onnx.ModelProto, header: WeightsHeader, smaller: Smaller
) -> tuple[onnx.ModelProto, WeightsHeader]:
    from offradar_ros.encoders.export.onnx_int8 import quantise, tensors_of  # noqa: PLC0415

    quantised = quantise(model, smaller.scans.images, smaller.method)
    found = fingerprint('int8', {'parent': header.fingerprint}, tensors_of(quantised))
    return quantised, _derived(header, found, 'int8 of', 'int8', smaller)


def _derived(header: WeightsHeader, found: str, what: str, stored: str, smaller: Smaller) -> WeightsHeader:
    """The header of another model, which tells what it was made of."""
    description = f'{header.description}; {what} {header.fingerprint}, fitted to {smaller.scans.source}'
    return dataclasses.replace(header, fingerprint=found, description=description, stored=stored)
