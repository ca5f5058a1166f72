"""Packed signatures without a scan."""

from __future__ import annotations

import numpy as np

from offradar_ros.alignment.signature import BRIGHTEST, Signature, SignatureConfig
from offradar_ros.alignment.signature_code import pack
from offradar_ros.config import PolarGridConfig


def packed_signature(seed: int, azimuths: int = 8, range_bins: int = 8) -> bytes:
    """A signature of random levels: some hundred bytes, or with 200 × 80, the most that there can be, about 8000."""
    rng = np.random.default_rng(seed)
    config = SignatureConfig(PolarGridConfig(azimuths, range_bins, 1.0, 1.0))
    image = rng.integers(0, BRIGHTEST + 1, (azimuths, range_bins), np.uint8)
    return pack(Signature(image, np.ones(azimuths, np.bool_), 0.0, 0.25, config=config))
