"""Random fields over azimuths and range whose neighbouring cells are correlated."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

_ONE = np.ones(1, np.float32)


class RangeFields:
    """White fields (A, C) smoothed along range and interpolated to `bins_per_cell` bins for each cell.

    The field, not its square, is interpolated linearly between the centres of cells, much as a zero-padded Fourier
    transform does. `sigma_cells` is the standard deviation of the Gaussian filter.
    """

    def __init__(self, cells: int, bins_per_cell: int, sigma_cells: float) -> None:
        self._bins_per_cell = bins_per_cell
        reach = int(np.ceil(2.5 * sigma_cells))
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma_cells) ** 2)
        weights /= np.sqrt(np.sum(weights**2))
        self._filter = weights.astype(np.float32)
        self._scale = _unit_variance(cells, bins_per_cell, float(np.sum(weights[1:] * weights[:-1])))

    def smooth(self, white: Image) -> Image:
        """(A, C · bins_per_cell) correlated field of unit variance from an (A, C) white one."""
        return np.asarray(self._interpolated(white) * self._scale, np.float32)

    def power(self, white: tuple[Image, Image]) -> Image:
        """(A, C · bins_per_cell) squared magnitude, mean 1, of a complex field with these (A, C) white parts."""
        total = np.square(self._interpolated(white[0]))
        total += np.square(self._interpolated(white[1]))
        total *= np.square(self._scale) * np.float32(0.5)
        return total

    def _interpolated(self, white: Image) -> Image:
        return interpolated(
            np.asarray(cv2.sepFilter2D(white, cv2.CV_32F, self._filter, _ONE), np.float32), self._bins_per_cell
        )


def interpolated(image: Image, bins_per_cell: int) -> Image:
    """(A, C) cells to (A, C · bins_per_cell) bins, linearly between the centres of cells."""
    if bins_per_cell == 1:
        return image
    size = (image.shape[1] * bins_per_cell, len(image))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _unit_variance(cells: int, bins_per_cell: int, correlation: float) -> Image:
    """(C · bins_per_cell,) factors for unit variance after interpolation; `correlation` is of neighbouring cells."""
    weight = np.abs((np.arange(bins_per_cell) + 0.5) / bins_per_cell - 0.5) if bins_per_cell > 1 else np.zeros(1)
    variance = weight**2 + (1.0 - weight) ** 2 + 2.0 * weight * (1.0 - weight) * correlation
    scale = np.tile(1.0 / np.sqrt(variance), cells)
    # The outer halves of the first and the last cell are not interpolated.
    scale[: bins_per_cell // 2] = scale[len(scale) - bins_per_cell // 2 :] = 1.0
    return scale.astype(np.float32)
