"""Encoded drives along one street, without an encoder."""

from __future__ import annotations

import numpy as np

from offradar_ros.calibration.encoded_drive import EncodedDrive


def encoded_street(index: int, count: int) -> EncodedDrive:
    """Scans 4 m apart; the descriptor is the place's, and noise that grows with U."""
    rng = np.random.default_rng([0, index])
    driven_m = 4.0 * np.arange(count, dtype=np.float64)
    severities = np.where(rng.random(count) < 0.4, rng.uniform(0.05, 1.0, count), 0.0)
    waves = np.random.default_rng(5).uniform(0.01, 0.2, 24)
    places = np.cos(driven_m[:, None] * waves)
    means = places + rng.normal(0.0, 1.0, places.shape) * (0.05 + 1.6 * severities[:, None])
    return EncodedDrive(
        name=f'street_{index + 1}',
        stamps_ns=np.arange(count, dtype=np.int64) * 10**9 + index * 10**14,
        poses=np.column_stack([driven_m, np.full(count, 1.0 * index), np.zeros(count)]),
        driven_m=driven_m,
        means=means.astype(np.float32),
        uncertainties=0.3 + severities + rng.normal(0.0, 0.05, count),
    )
