"""Radar images: recorded ones as their files hold them, and random speckle."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def read_image(path: Path) -> NDArray[np.uint8]:
    """Gray image (rows, columns), metadata columns included."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    assert image.dtype == np.uint8, path
    return np.asarray(image, np.uint8)


def speckle(count: int, shape: tuple[int, int], seed: int = 9) -> NDArray[np.uint8]:
    """Images (count, rows, columns) of gamma-distributed power."""
    power = np.random.default_rng(seed).gamma(1.5, 20.0, (count, *shape))
    return np.minimum(power, 255).astype(np.uint8)
