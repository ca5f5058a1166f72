"""Weights for release: in half precision, with a mean U of 1 over a clean drive. Needs torch."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from offradar_ros.calibration.variance_scale import variance_factor
from offradar_ros.encoders.encode import encode_all
from offradar_ros.encoders.networks.files import load_network, save_network
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.networks.without_batch_norm import without_batch_norm
from offradar_ros.encoders.torch_backend import TorchEncoder
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ModelError
from offradar_ros.processes import Progress
from offradar_ros.sequence import RadarSequence


def ship(
    weights: Path,
    out: Path,
    *,
    half: bool,
    clean_drive: RadarSequence | None,
    progress: Progress | None = None,
) -> WeightsHeader:
    """Write `weights` again as `out`, with `half` in half precision; the header's description names the scale.

    A VGG-16 with batch normalisation becomes the plain one (see `without_batch_norm`).
    Over `clean_drive` the variance is scaled so that U is 1 on average (the prior's, Sec. III-C); without one it stays.
    ModelError for weights that cannot be read or whose method has no such scale.
    """
    network, header = load_network(weights)
    description = header.description
    if clean_drive is not None:
        if not isinstance(network, VariationalNetwork):
            raise ModelError(
                f'{weights}: expected weights of the variational method to scale, got {header.config.method}'
            )
        _, variances = encode_all(TorchEncoder(weights), clean_drive, progress)
        factor = variance_factor(np.nanmean(variances, axis=1))
        network.scale_variance(factor)
        description = (
            f'{description}; variance × {factor:.6g}, for U = 1 over {len(clean_drive)} scans of {clean_drive.name}'
        )
    return save_network(out, without_batch_norm(network), description, half)
