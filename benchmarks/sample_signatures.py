"""Packed signatures: without a scan, and many of few scans."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

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


def packed_turns(signatures: Sequence[Signature], count: int) -> list[bytes]:
    """That many different signatures: those given, each turned by one sector after the other."""
    turned = []
    for number in range(count):
        turns, index = divmod(number, len(signatures))
        signature = signatures[index]
        image, seen = np.roll(signature.image, turns, axis=0), np.roll(signature.seen, turns)
        turned.append(pack(dataclasses.replace(signature, image=image, seen=seen)))
    return turned
