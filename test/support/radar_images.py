"""Recorded radar images as their files hold them."""

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
