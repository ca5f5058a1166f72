"""An encoder of your own: the median power of each ring over azimuth, which turning on the spot does not change."""

from __future__ import annotations

import numpy as np

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.fingerprint import fingerprint
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.rings import ring_power
from offradar_ros.errors import RefusedInput
from offradar_ros.types import Embedding, PolarScan

# Every setting that changes an embedding belongs into the fingerprint: maps of other settings are then refused.
SETTINGS = {'rings': 64, 'max_range_m': 100.0, 'min_range_m': 2.5}


class MedianRings:
    """Median power of 64 rings, L2-normalised; the variance is small where azimuths differ."""

    runs_on = 'cpu'

    def __init__(self, config: EncoderConfig) -> None:
        """`config.weights`, `config.threads` and `config.device` are for an encoder that has a network."""
        self.info = ModelInfo('median_rings', fingerprint('median_rings', SETTINGS), 64, {'config': config.name})

    def encode(self, scan: PolarScan) -> Embedding:
        """Mean (64,) and variance (64,), float32."""
        power = ring_power(scan, **SETTINGS)
        if not power.any():
            raise RefusedInput('no_signal', f'scan at {scan.stamp_ns} ns holds no power within 100 m')
        median = np.median(power, axis=0)
        mean = median / (np.linalg.norm(median) or 1.0)
        variance = 1.0 / (1.0 + power.std(axis=0) / power.mean())
        return Embedding(scan.stamp_ns, mean.astype(np.float32), variance.astype(np.float32), self.info.fingerprint)
