"""Accuracy and cost of the Cartesian image: see README.md."""

from __future__ import annotations

import dataclasses
import time

import cv2
import numpy as np
from numpy.typing import NDArray
from scan_sources import read_arguments, scan_sources

from offradar_ros.config import CartesianConfig
from offradar_ros.radar.cartesian import PolarToCartesian
from offradar_ros.types import PolarScan

CONFIG = CartesianConfig()
FINE = 16
ROWS_AT_ONCE = 4
WARM_UP, REPEATS = 5, 40


def supersampled(scan: PolarScan) -> NDArray[np.float64]:
    """(S, S) mean of 16 × 16 bilinear samples of the polar power in each pixel: the reference image."""
    side, bins = CONFIG.side_px, scan.power.shape[1]
    order = np.argsort(scan.azimuths_rad)
    angles = scan.azimuths_rad[order]
    around = np.concatenate([angles[-1:] - 2 * np.pi, angles, angles[:1] + 2 * np.pi])
    power = scan.power[np.concatenate([order[-1:], order, order[:1]])].astype(np.float32).reshape(-1)
    right_m = ((np.arange(side * FINE) + 0.5) / FINE - side / 2) * CONFIG.resolution_m
    image = np.empty((side, side))
    for top in range(0, side, ROWS_AT_ONCE):
        forward_m = -right_m[top * FINE : (top + ROWS_AT_ONCE) * FINE, np.newaxis]
        range_m = np.hypot(forward_m, right_m)
        at = (range_m - scan.range_offset_m) / scan.range_resolution_m
        seen = (range_m >= CONFIG.min_range_m) & (at >= 0) & (at < bins)
        row = np.interp(np.mod(np.arctan2(right_m, forward_m), 2 * np.pi), around, np.arange(len(around)))
        column = np.clip(at - 0.5, 0, bins - 1)
        r, k = np.minimum(row.astype(np.int32), len(around) - 2), np.minimum(column.astype(np.int32), bins - 2)
        first = r * bins + k
        near = power[first] + (column - k) * (power[first + 1] - power[first])
        far = power[first + bins] + (column - k) * (power[first + bins + 1] - power[first + bins])
        samples = np.where(seen, near + (row - r) * (far - near), 0.0)
        image[top : top + ROWS_AT_ONCE] = samples.reshape(ROWS_AT_ONCE, FINE, side, FINE).mean(axis=(1, 3))
    return image


def milliseconds(convert: PolarToCartesian, scans: list[PolarScan]) -> str:
    """Median and quartiles of one conversion, after a warm-up, with `scans` in turn."""
    taken = []
    for i in range(WARM_UP + REPEATS):
        started_s = time.perf_counter()
        convert(scans[i % len(scans)])
        taken.append(time.perf_counter() - started_s)
    low, median, high = np.percentile(taken[WARM_UP:], [25, 50, 75]) * 1e3
    return f'{median:5.2f} ({low:.2f} to {high:.2f})'


def main() -> None:
    """Print one line for each source of scans."""
    arguments = read_arguments(__doc__ or '')
    cv2.setNumThreads(1)
    print(f'{"source":20} {"shape":>10}  correlation  {"ms":20}  ms, new azimuths')
    for name, (scan, *_) in scan_sources(arguments.real, most=1):
        convert = PolarToCartesian(CONFIG)
        image = convert(scan)
        correlation = np.corrcoef(image.ravel(), supersampled(scan).ravel())[0, 1]
        # Two rotations of a real sensor never start at exactly the same angle.
        turned = [
            dataclasses.replace(scan, azimuths_rad=np.mod(scan.azimuths_rad + shift, 2 * np.pi))
            for shift in (0.0, 1e-4)
        ]
        shape = '{} × {}'.format(*scan.power.shape)
        same, new = milliseconds(convert, [scan]), milliseconds(convert, turned)
        print(f'{name:20} {shape:>10}  {correlation:11.5f}  {same:20}  {new}', flush=True)


if __name__ == '__main__':
    main()
