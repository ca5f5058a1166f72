"""Exports a weights file to ONNX, for vehicles without torch. A call needs torch, safetensors and onnx."""

from __future__ import annotations

import dataclasses
import tempfile
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from offradar_ros.encoders.export.calibration_scans import CalibrationScans
from offradar_ros.encoders.export.onnx_probe import probe_onnx
from offradar_ros.encoders.fingerprint import Setting, fingerprint
from offradar_ros.encoders.model_files import require_package, write_atomically
from offradar_ros.encoders.onnx_digest import with_digest
from offradar_ros.encoders.onnx_file import metadata_entry
from offradar_ros.encoders.onnx_model import PROBE
from offradar_ros.encoders.probe import Probe, probe_image, require_sound
from offradar_ros.encoders.weights_header import WeightsHeader

if TYPE_CHECKING:
    import onnx

    from offradar_ros.encoders.networks.network import Network

INT8_OPSET = 17


@dataclasses.dataclass(frozen=True, eq=False)
class Compression:
    """Compression of an exported network. The result is another model than the weights, with another fingerprint.

    Attributes:
        scans: calibration scans.
        int8: whether to quantise to 8-bit integers.
        method: method for the ranges of activations, a name in `onnx_int8.METHODS`.
        low_rank: share of the convolutions' multiplications that is kept by low-rank factorisation; 1 keeps all.
    """

    scans: CalibrationScans
    int8: bool = False
    method: str = 'minmax'
    low_rank: float = 1.0


def export_onnx(
    weights_path: str | Path, onnx_path: str | Path, compression: Compression | None = None
) -> WeightsHeader:
    """Write an ONNX file for `OnnxEncoder`; returns its header, which without `compression` is that of the weights.

    The input is ``images`` (N, H, W) uint8, so that scaling and normalisation are part of the graph; outputs are
    ``mean`` and ``variance`` (N, d) float32; N is dynamic. Half-precision weights are stored in half precision and
    computed in single precision. The same weights and scans give the same file on one machine. It ends with a digest of
    all that it holds, and is written atomically. ModelError for weights that cannot be read, a file that cannot be
    written or a missing package.
    """
    for package in ('torch', 'safetensors', 'onnx', *(('onnxruntime',) if compression and compression.int8 else ())):
        require_package(package, weights_path)
    import onnx  # noqa: PLC0415

    from offradar_ros.encoders.export.onnx_half import store_half_precision  # noqa: PLC0415
    from offradar_ros.encoders.export.onnx_opencv import OPSET, rewrite_for_opencv  # noqa: PLC0415
    from offradar_ros.encoders.networks.files import load_network  # noqa: PLC0415

    network, header = load_network(weights_path)
    if compression and compression.low_rank < 1.0:
        header = _factorised(network, header, compression)
    if compression and compression.int8:
        model, header = _quantised(_graph(network, header, INT8_OPSET), header, compression)
    else:
        model = _graph(network, header, OPSET)
        rewrite_for_opencv(model)
        if header.stored == 'float16':
            store_half_precision(model)
    for key, value in header.to_metadata().items():
        model.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(model, full_check=True)
    quantised = bool(compression and compression.int8)
    content = model.SerializeToString(deterministic=True)
    probe = probe_onnx(content, header, onnx_path) if quantised else _probe(network, header, weights_path)
    write_atomically(onnx_path, with_digest(content + metadata_entry(PROBE, probe.to_text())))
    return header


def _probe(network: Network, header: WeightsHeader, path: str | Path) -> Probe:
    import torch  # noqa: PLC0415

    with torch.inference_mode():
        mean, variance = network.embed(torch.from_numpy(probe_image(header.config)))
    require_sound((mean.numpy(), variance.numpy()), header.config, path)
    return Probe.of(mean.numpy(), variance.numpy())


def _graph(network: Network, header: WeightsHeader, opset: int) -> onnx.ModelProto:
    import onnx  # noqa: PLC0415
    import torch  # noqa: PLC0415

    class Inference(torch.nn.Module):
        """The part of the network that runs on a vehicle."""

        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return self.network.embed(images)

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), torch.no_grad():
        exported = Path(folder) / 'network.onnx'
        # The exporter without further packages is deprecated, and warns.
        warnings.simplefilter('ignore')
        torch.onnx.export(
            Inference().eval(),
            (torch.zeros((1, *header.config.image_shape), dtype=torch.uint8),),
            exported,
            dynamo=False,
            opset_version=opset,
            # Batch normalisation is not folded into convolutions, so that the weights are those of the file.
            training=torch.onnx.TrainingMode.PRESERVE,
            input_names=['images'],
            output_names=['mean', 'variance'],
            dynamic_axes={'images': {0: 'N'}, 'mean': {0: 'N'}, 'variance': {0: 'N'}},
        )
        return onnx.load(exported)


def _factorised(network: Network, header: WeightsHeader, compression: Compression) -> WeightsHeader:
    """Factorise the network in place; returns its new header."""
    from offradar_ros.encoders.networks.low_rank import factorise, round_to_half_precision  # noqa: PLC0415

    factorise(network, compression.scans.images, compression.low_rank)
    if header.stored == 'float16':
        round_to_half_precision(network)
    settings: dict[str, Setting] = {'parent': header.fingerprint, 'share': compression.low_rank}
    tensors = {name: tensor.detach().numpy() for name, tensor in network.state_dict().items()}
    return _derived(
        header,
        fingerprint('low_rank', settings, tensors),
        f'low rank, {compression.low_rank:g} of',
        header.stored,
        compression,
    )


def _quantised(
    model: onnx.ModelProto, header: WeightsHeader, compression: Compression
) -> tuple[onnx.ModelProto, WeightsHeader]:
    from offradar_ros.encoders.export.onnx_int8 import quantise, tensors_of  # noqa: PLC0415

    quantised = quantise(model, compression.scans.images, compression.method)
    found = fingerprint('int8', {'parent': header.fingerprint}, tensors_of(quantised))
    return quantised, _derived(header, found, 'int8 of', 'int8', compression)


def _derived(header: WeightsHeader, found: str, what: str, stored: str, compression: Compression) -> WeightsHeader:
    """The header of a derived model; its description names the original."""
    description = f'{header.description}; {what} {header.fingerprint}, fitted to {compression.scans.source}'
    return dataclasses.replace(header, fingerprint=found, description=description, stored=stored)
