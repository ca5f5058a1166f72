"""Rough poses of a query in the frame of a map scan, without knowing anything: rotation first, then translation.

Rotation in two ways. The polar images are correlated along azimuth, summed over the near ranges, which is right for
small translations. The magnitude of the Fourier transform of the image from above does not change with translation at
all, and turns with the image (Fourier-Mellin), but is the same after half a turn. Then translation, by phase
correlation of the images from above with the query turned by each of the likely angles.
"""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.top_down import TopDown

_NEAR_SHARE = 0.65
"""Share of the ranges whose rotation counts: the near ones have more to say, and move more with the vehicle ..."""
_SMOOTH_SECTORS, _SMOOTH_CELLS = 1.2, 1.5
"""... so they are compared smoothly."""
_APART = 6
_WHITENED = 0.7
"""0 is plain correlation and 1 phase correlation, which gives noise as much weight as returns."""
_EDGE_CELLS = 4.0
_DIRECTIONS = 180
_LOWEST, _HIGHEST = 4, 0.8
"""First frequency in cycles of the padded image, and the last one as a share of the largest."""


@dataclasses.dataclass(frozen=True, eq=False)
class Spectra:
    """What rotation and translation are found from.

    Attributes:
        azimuths: (A/2 + 1, C) complex64, of the polar image along azimuth.
        directions: (B/2 + 1, F) complex64, of the magnitude of the spectrum along direction, over half a turn.
        image: (S, S) float32, from above, with mean 0 and soft edges.
        cell_m: metres of its pixels.
        sectors: A.
    """

    azimuths: NDArray[np.complex64]
    directions: NDArray[np.complex64]
    image: NDArray[np.float32]
    cell_m: float
    sectors: int


def spectra(signature: Signature, view: TopDown) -> Spectra:
    """What both scans need once; `view` is at the resolution of the translation."""
    sectors = len(signature.image)
    near = signature.image[:, : round(_NEAR_SHARE * signature.config.grid.range_bins)].astype(np.float32)
    around = np.concatenate([near[-8:], near, near[:8]])
    smooth = cv2.GaussianBlur(around, (0, 0), sigmaX=_SMOOTH_CELLS, sigmaY=_SMOOTH_SECTORS)[8:-8]
    azimuths = np.fft.rfft(smooth - smooth.mean(axis=0), axis=0).astype(np.complex64)
    across = np.arange(view.side) + 0.5 - view.side / 2.0
    inside = view.side / 2.0 - np.hypot(across[None, :], across[:, None])
    taper = np.clip(inside / _EDGE_CELLS, 0.0, 1.0).astype(np.float32)
    mean = float((view.image * taper).sum() / taper.sum())
    image = (view.image - mean) * taper
    return Spectra(azimuths, _directions(image), image, view.cell_m, sectors)


def _directions(image: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Of the magnitude of the image's spectrum, sampled by direction over half a turn and by frequency."""
    side = 2 * len(image)
    magnitude = np.log1p(np.abs(np.fft.fftshift(np.fft.fft2(image, (side, side))))).astype(np.float32)
    angles = (np.arange(_DIRECTIONS) * (math.pi / _DIRECTIONS))[:, None]
    frequencies = np.arange(_LOWEST, _HIGHEST * side / 2)[None, :]
    columns = (side / 2 + frequencies * np.cos(angles)).astype(np.float32)
    rows = (side / 2 + frequencies * np.sin(angles)).astype(np.float32)
    polar = cv2.remap(cv2.GaussianBlur(magnitude, (0, 0), 1.0), columns, rows, cv2.INTER_LINEAR)
    polar -= polar.mean(axis=0)
    return np.fft.rfft(polar, axis=0).astype(np.complex64)


def rough_poses(place: Spectra, query: Spectra, most: int, reach_m: float) -> list[NDArray[np.float64]]:
    """Up to `most` poses (x, y, yaw) of the query, the likeliest first, within `reach_m` of the place."""
    side = 2 * len(place.image)
    before = np.fft.rfft2(place.image, (side, side))
    limit = min(round(reach_m / place.cell_m), len(place.image) - 1)
    found: list[tuple[float, NDArray[np.float64]]] = []
    for yaw in _yaws(place, query, most):
        turned = np.fft.rfft2(_turned(query.image, yaw), (side, side))
        cross = before * np.conj(turned)
        surface = np.fft.irfft2(cross / (np.abs(cross) ** _WHITENED + 1e-6), (side, side))
        # Shifts around zero, in both directions.
        around = np.roll(surface, (limit, limit), (0, 1))[: 2 * limit + 1, : 2 * limit + 1]
        row, column = np.unravel_index(int(np.argmax(around)), around.shape)
        height = float(around[row, column] / max(float(surface.std()), 1e-9))
        shift = (column - limit) * place.cell_m, (row - limit) * place.cell_m
        found.append((height, np.array([*shift, yaw])))
    return [pose for _, pose in sorted(found, key=lambda item: -item[0])]


def _yaws(place: Spectra, query: Spectra, most: int) -> list[float]:
    """About `most` likely yaws of the query, in radians: half of them by azimuth, half by direction."""
    by_azimuth = np.fft.irfft(np.sum(place.azimuths * np.conj(query.azimuths), axis=1), n=place.sectors)
    by_direction = np.fft.irfft(np.sum(place.directions * np.conj(query.directions), axis=1), n=_DIRECTIONS)
    # Azimuths are clockwise, directions from x to y. A row of the query is so many rows later in the place.
    yaws = [-2.0 * math.pi * peak / place.sectors for peak in _peaks(by_azimuth, most // 2)]
    for peak in _peaks(by_direction, most // 4 or 1):
        yaws += [math.pi * peak / _DIRECTIONS, math.pi * peak / _DIRECTIONS + math.pi]
    return [math.remainder(yaw, 2.0 * math.pi) for yaw in yaws]


def _peaks(likeness: NDArray[np.float64], most: int) -> list[int]:
    """Indices of the highest values, apart from one another."""
    likeness, peaks = likeness.copy(), []
    for _ in range(most):
        peaks.append(int(np.argmax(likeness)))
        likeness[np.arange(peaks[-1] - _APART, peaks[-1] + _APART + 1) % len(likeness)] = -np.inf
    return peaks


def _turned(image: NDArray[np.float32], yaw_rad: float) -> NDArray[np.float32]:
    """The image in a frame in which the vehicle has this yaw."""
    middle = len(image) / 2.0 - 0.5
    # OpenCV turns from x to −y for positive angles.
    matrix = cv2.getRotationMatrix2D((middle, middle), -math.degrees(yaw_rad), 1.0)
    return np.asarray(cv2.warpAffine(image, matrix, image.shape), np.float32)
