"""How far and in which direction the radar moved between two scans, by correlation of their images."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2

from offradar_ros.types import PolarScan

_TURNS = 125
_LEAST_SCORE = 0.85
"""Where a scan resembles the reference less than this, the scan before becomes the reference."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """The pose of a scan in the frame of another: forward and right in metres, clockwise turn in radians.

    `score` is the correlation of both images after that motion, at most 1.
    """

    forward_m: float
    right_m: float
    turn_rad: float
    score: float

    def then(self, other: Motion) -> Motion:
        """This motion, and then `other` in the frame that it leads to; the score is that of `other`."""
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return Motion(
            self.forward_m + cos * other.forward_m - sin * other.right_m,
            self.right_m + sin * other.forward_m + cos * other.right_m,
            self.turn_rad + other.turn_rad,
            other.score,
        )


def strongest(scan: PolarScan, share: float) -> PolarScan:
    """The scan with this share of its returns, the others set to 0: its noise would not move with the radar."""
    least = np.quantile(scan.power, 1.0 - share)
    return dataclasses.replace(scan, power=np.where(scan.power < least, 0, scan.power).astype(np.uint8))


class Registration:
    """Motion to any heading, found among 125 turns and all shifts by whole cells of an image of 128 × 128.

    Image convention of `PolarToCartesian`. `reach_m` is a quarter of the image's side: returns up to twice as far are
    used. Nearer than `blank_m` they are of the vehicle itself.
    """

    def __init__(self, reach_m: float, blank_m: float) -> None:
        self._side = 128
        self._cell_m = 4.0 * reach_m / self._side
        across_m = (np.arange(self._side) + 0.5 - self._side / 2) * self._cell_m
        forward_m, right_m = -across_m[:, np.newaxis], across_m[np.newaxis, :]
        self._range_m = np.hypot(forward_m, right_m)
        self._azimuth_turns = np.mod(np.arctan2(right_m, forward_m) / (2.0 * np.pi), 1.0)
        self._blank_m = blank_m

    def motion(self, reference: PolarScan, scan: PolarScan) -> Motion:
        """The pose of `scan` in the frame of `reference`; both with equally spaced azimuths from 0."""
        turns = np.arange(_TURNS) / _TURNS
        images = np.stack([self._image(scan, turn) for turn in turns])
        spectra = rfft2(self._image(reference, 0.0)) * np.conj(rfft2(images))
        scores = irfft2(spectra, images.shape[1:])
        best, row, column = np.unravel_index(np.argmax(scores), scores.shape)
        down, across = ((int(at) + self._side // 2) % self._side - self._side // 2 for at in (row, column))
        return Motion(
            -down * self._cell_m, across * self._cell_m, 2.0 * math.pi * turns[best], float(scores[best, row, column])
        )

    def follow(self, scans: Iterable[PolarScan], reference: PolarScan) -> Iterator[Motion]:
        """The pose of each scan in the frame of `reference`, by way of scans between where it resembles it too little.

        Successive scans must overlap.
        """
        base = Motion(0.0, 0.0, 0.0, 1.0)
        last: tuple[PolarScan, Motion] | None = None
        for scan in scans:
            step = self.motion(reference, scan)
            if step.score < _LEAST_SCORE and last is not None:
                reference, base = last
                step = self.motion(reference, scan)
            pose = base.then(step)
            last = scan, pose
            yield pose

    def _image(self, scan: PolarScan, turn: float) -> NDArray[np.float32]:
        """Log power of the scan turned clockwise, of mean 0 and length 1."""
        rows = len(scan.power)
        power = np.log1p(scan.power.astype(np.float32))
        power[:, : math.ceil(self._blank_m / scan.range_resolution_m)] = 0.0
        columns = ((self._range_m - scan.range_offset_m) / scan.range_resolution_m - 0.5).astype(np.float32)
        # The row after the last is the first.
        azimuths = (np.mod(self._azimuth_turns - turn, 1.0) * rows).astype(np.float32)
        image = cv2.remap(np.concatenate([power, power[:1]]), columns, azimuths, cv2.INTER_LINEAR)
        image = cv2.GaussianBlur(image, (0, 0), 1.0)
        image -= image.mean()
        return np.asarray(image / max(float(np.linalg.norm(image)), 1e-12), np.float32)
