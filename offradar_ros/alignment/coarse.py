"""Rough poses of a query in the frame of a map scan, without knowing anything: rotation first, then translation.

Rotation in two ways. The polar images are correlated along azimuth, summed over the near ranges, which is right for
small translations. The magnitude of the Fourier transform of the image from above does not change with translation at
all, and turns with the image (Fourier-Mellin), but is the same after half a turn. Then translation, by phase
correlation of the images from above with the query turned by each of the likely angles.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.signature import Signature, SignatureConfig
from offradar_ros.alignment.top_down import TopDown, across_m

REACH_M = 20.0
"""Farther away than this, a place is not aligned with."""
_NEAR_SHARE = 0.65
"""Share of the ranges whose rotation counts: the near ones have more to say, and move more with the vehicle ..."""
_SMOOTH_SECTORS, _SMOOTH_CELLS = 1.2, 1.5
"""... so they are compared smoothly."""
_PEAKS_BY_AZIMUTH, _PEAKS_BY_DIRECTION = 3, 1
_APART_RAD = math.radians(5.0)
"""Yaws nearer to one another are the same."""
_WHITENED = 0.7
"""0 is plain correlation and 1 phase correlation, which gives noise as much weight as returns."""
_EDGE_CELLS = 4.0
_DIRECTIONS = 180
_LOWEST, _HIGHEST = 3, 0.8
"""First frequency in cycles of the padded image, and the last one as a share of the largest."""


@dataclasses.dataclass(frozen=True, eq=False)
class Spectra:
    """What rotation and translation are found from.

    Attributes:
        azimuths: (A/2 + 1, C) complex64, of the polar image along azimuth.
        directions: (B/2 + 1, F) complex64, of the magnitude of the spectrum along direction, over half a turn.
        whitened: (S, S) float32, from above, with all frequencies about equally strong and a margin around it.
        cell_m: metres of its pixels.
        config: how the signature was made.
    """

    azimuths: NDArray[np.complex64]
    directions: NDArray[np.complex64]
    whitened: NDArray[np.float32]
    cell_m: float
    config: SignatureConfig

    @functools.cached_property
    def transformed(self) -> NDArray[np.float32]:
        """(S, S) float32 the spectrum of `whitened`, as OpenCV packs that of a real image."""
        return np.asarray(cv2.dft(self.whitened), np.float32)


def spectra(signature: Signature, view: TopDown) -> Spectra:
    """What both scans need once; `view` is at the resolution of the translation."""
    near = signature.image[:, : round(_NEAR_SHARE * signature.config.grid.range_bins)].astype(np.float32)
    around = np.concatenate([near[-8:], near, near[:8]])
    smooth = cv2.GaussianBlur(around, (0, 0), sigmaX=_SMOOTH_CELLS, sigmaY=_SMOOTH_SECTORS)[8:-8]
    azimuths = np.fft.rfft(smooth - smooth.mean(axis=0), axis=0).astype(np.complex64)
    taper = _taper(view.side)
    mean = float((view.image * taper).sum() / taper.sum())
    # A shift within reach must not bring the far edge of the image back in.
    margin = (cv2.getOptimalDFTSize(view.side + math.ceil(REACH_M / view.cell_m)) - view.side + 1) // 2
    padded = cv2.copyMakeBorder((view.image - mean) * taper, margin, margin, margin, margin, cv2.BORDER_CONSTANT)
    real, imaginary = cv2.split(cv2.dft(padded, flags=cv2.DFT_COMPLEX_OUTPUT))
    strength = np.asarray(cv2.log(cv2.magnitude(real, imaginary) + 1.0), np.float32)
    weaker = cv2.exp(-_WHITENED * strength)
    spectrum = cv2.merge([real * weaker, imaginary * weaker])
    whitened = np.asarray(cv2.idft(spectrum, flags=cv2.DFT_REAL_OUTPUT | cv2.DFT_SCALE), np.float32)
    return Spectra(azimuths, _directions(strength), whitened, view.cell_m, signature.config)


def _directions(strength: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Of the magnitude of the image's spectrum, sampled by direction over half a turn and by frequency."""
    zero = len(strength) // 2
    shifted = cv2.GaussianBlur(np.roll(strength, (zero, zero), (0, 1)), (0, 0), 1.0)
    polar = cv2.remap(shifted, *_frequencies(len(strength)), cv2.INTER_LINEAR)
    return np.fft.rfft(polar - polar.mean(axis=0), axis=0).astype(np.complex64)


@functools.lru_cache(maxsize=4)
def _taper(side: int) -> NDArray[np.float32]:
    """(S, S) 1 but for soft edges of the disc."""
    middle = across_m(side, 1.0)
    inside = side / 2.0 - np.hypot(middle[None, :], middle[:, None])
    return np.clip(inside / _EDGE_CELLS, 0.0, 1.0).astype(np.float32)


@functools.lru_cache(maxsize=4)
def _frequencies(side: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Columns and rows, (B, F) each, of a spectrum by direction and frequency, with frequency 0 at side // 2."""
    angles = (np.arange(_DIRECTIONS) * (math.pi / _DIRECTIONS))[:, None]
    frequencies = np.arange(_LOWEST, _HIGHEST * side / 2)[None, :]
    columns, rows = side // 2 + frequencies * np.cos(angles), side // 2 + frequencies * np.sin(angles)
    return columns.astype(np.float32), rows.astype(np.float32)


def rough_poses(place: Spectra, query: Spectra) -> NDArray[np.float64]:
    """(K, 3) poses (x, y, yaw) of the query, the likeliest first, within `REACH_M` of the place."""
    before = place.transformed
    limit = math.floor(REACH_M / place.cell_m)
    shifts = np.arange(-limit, limit + 1)
    heights, poses = [], []
    for yaw in _yaws(place, query):
        turned = cv2.dft(_turned(query.whitened, yaw))
        surface = cv2.idft(cv2.mulSpectrums(before, turned, 0, conjB=True), flags=cv2.DFT_REAL_OUTPUT)
        around = surface[shifts[:, None], shifts[None, :]]
        row, column = np.unravel_index(int(np.argmax(around)), around.shape)
        heights.append(float(around[row, column]))
        poses.append((shifts[column] * place.cell_m, shifts[row] * place.cell_m, yaw))
    return np.array(poses)[np.argsort(heights)[::-1]]


def _yaws(place: Spectra, query: Spectra) -> list[float]:
    """Likely yaws of the query, in radians."""
    sectors = place.config.grid.azimuths
    by_azimuth = np.fft.irfft(np.sum(place.azimuths * np.conj(query.azimuths), axis=1), n=sectors)
    by_direction = np.fft.irfft(np.sum(place.directions * np.conj(query.directions), axis=1), n=_DIRECTIONS)
    # Azimuths are clockwise, directions from x to y. A row of the query is so many rows later in the place.
    yaws = [-2.0 * math.pi * peak / sectors for peak in _peaks(by_azimuth, _PEAKS_BY_AZIMUTH)]
    for peak in _peaks(by_direction, _PEAKS_BY_DIRECTION):
        yaws += [math.pi * peak / _DIRECTIONS, math.pi * peak / _DIRECTIONS + math.pi]
    chosen: list[float] = []
    for yaw in yaws:
        if all(abs(math.remainder(yaw - other, 2.0 * math.pi)) > _APART_RAD for other in chosen):
            chosen.append(math.remainder(yaw, 2.0 * math.pi))
    return chosen


def _peaks(likeness: NDArray[np.float64], most: int) -> list[int]:
    """Indices of the highest values, apart from one another."""
    apart = 6
    likeness, peaks = likeness.copy(), []
    for _ in range(most):
        peaks.append(int(np.argmax(likeness)))
        likeness[np.arange(peaks[-1] - apart, peaks[-1] + apart + 1) % len(likeness)] = -np.inf
    return peaks


def _turned(image: NDArray[np.float32], yaw_rad: float) -> NDArray[np.float32]:
    """The image in a frame in which the vehicle has this yaw."""
    middle = len(image) / 2.0 - 0.5
    # OpenCV turns from x to −y for positive angles.
    matrix = cv2.getRotationMatrix2D((middle, middle), -math.degrees(yaw_rad), 1.0)
    return np.asarray(cv2.warpAffine(image, matrix, image.shape), np.float32)
