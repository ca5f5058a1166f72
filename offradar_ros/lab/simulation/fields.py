"""Random fields over azimuths and range whose neighbouring cells are alike."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

_ONE = np.ones(1, np.float32)


class RangeFields:
    """White fields (A, C) made alike along range, and interpolated to bins of which `finer` make a cell.

    The field, not its square, is interpolated linearly between the cells' centres, much as a zero-padded Fourier
    transform does.
    """

    def __init__(self, cells: int, finer: int, sigma_cells: float) -> None:
        self._finer = finer
        reach = int(np.ceil(2.5 * sigma_cells))
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_cells) ** 2)
        weights /= np.sqrt(np.sum(weights**2))
        self._filter = weights.astype(np.float32)
        self._scale = _unit_variance(cells, finer, float(np.sum(weights[1:] * weights[:-1])))

    def smooth(self, white: Image) -> Image:
        """(A, C · finer) field of unit variance from a white one."""
        return np.asarray(self._interpolated(white) * self._scale, np.float32)

    def power(self, white: tuple[Image, Image]) -> Image:
        """(A, C · finer) squared magnitude, mean 1, of the complex field with these white parts."""
        total = np.square(self._interpolated(white[0]))
        total += np.square(self._interpolated(white[1]))
        total *= np.square(self._scale) * np.float32(0.5)
        return total

    def _interpolated(self, white: Image) -> Image:
        return interpolated(np.asarray(cv2.sepFilter2D(white, cv2.CV_32F, self._filter, _ONE), np.float32), self._finer)


def interpolated(image: Image, finer: int) -> Image:
    """(A, C) cells to (A, C · finer) bins, linearly between the cells' centres."""
    if finer == 1:
        return image
    size = (image.shape[1] * finer, len(image))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _unit_variance(cells: int, finer: int, neighbours: float) -> Image:
    """(C · finer,) factors that give an interpolated field unit variance; `neighbours` is its cells' correlation."""
    weight = np.abs((np.arange(finer) + 0.5) / finer - 0.5) if finer > 1 else np.zeros(1)
    variance = weight**2 + (1.0 - weight) ** 2 + 2.0 * weight * (1.0 - weight) * neighbours
    scale = np.tile(1.0 / np.sqrt(variance), cells)
    # The outer halves of the first and the last cell have no neighbour to lean on.
    scale[: finer // 2] = scale[len(scale) - finer // 2 :] = 1.0
    return scale.astype(np.float32)
