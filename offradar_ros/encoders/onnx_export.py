"""Writes a weights file as ONNX, for vehicles without torch. Needs torch, safetensors and onnx, when called."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

from offradar_ros.encoders.model_files import require_package, write_atomically
from offradar_ros.encoders.weights_header import WeightsHeader

OPSET = 17


def export_onnx(weights_path: str | Path, onnx_path: str | Path) -> WeightsHeader:
    """Write what `OnnxEncoder` reads; returns the header that both files carry.

    Input ``images`` (N, H, W) uint8, so that scaling and normalisation are part of the graph; outputs ``mean`` and
    ``variance`` (N, d) float32; N is free. Weights stored in half precision are stored so here too, and computed with
    in single precision. The file is written whole or not at all. ModelError for weights that cannot be read, a file
    that cannot be written or a missing package.
    """
    for package in ('torch', 'safetensors', 'onnx'):
        require_package(package, weights_path)
    import onnx  # noqa: PLC0415
    import torch  # noqa: PLC0415

    from offradar_ros.encoders.network_files import load_network  # noqa: PLC0415
    from offradar_ros.encoders.networks import Network  # noqa: PLC0415
    from offradar_ros.encoders.onnx_half import store_halves  # noqa: PLC0415

    class Inference(torch.nn.Module):
        """The part of the network that a vehicle runs."""

        def __init__(self, network: Network) -> None:
            super().__init__()
            self.network = network

        def forward(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return self.network.embed(images)

    network, header = load_network(weights_path)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), torch.no_grad():
        exported = Path(folder) / 'network.onnx'
        # The exporter that needs no further package is deprecated, and says so at length.
        warnings.simplefilter('ignore')
        torch.onnx.export(
            Inference(network).eval(),
            (torch.zeros((1, *header.config.image_shape), dtype=torch.uint8),),
            exported,
            dynamo=False,
            opset_version=OPSET,
            # Batch normalisation stays apart from its convolution, so that the weights are those of the file.
            training=torch.onnx.TrainingMode.PRESERVE,
            input_names=['images'],
            output_names=['mean', 'variance'],
            dynamic_axes={'images': {0: 'N'}, 'mean': {0: 'N'}, 'variance': {0: 'N'}},
        )
        model = onnx.load(exported)
    if header.stored == 'float16':
        store_halves(model)
    for key, value in header.to_metadata().items():
        model.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(model, full_check=True)
    write_atomically(onnx_path, model.SerializeToString())
    return header
