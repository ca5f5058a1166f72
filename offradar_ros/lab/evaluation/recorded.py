"""U of recorded scans, as they are and spoiled on their bytes: does what was learned in simulation hold outside it?"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.lab.evaluation.summary import Json
from offradar_ros.recordings.source import open_source
from offradar_ros.types import PolarScan

CLEAN = 'oxford_tiny'
FOG = 'radiate_tiny_foggy'
"""Folders of recorded drives: Oxford Radar RobotCar in clear weather, RADIATE in fog."""

NOISE_CORRELATION_M = 0.165
"""A receiver's range bins are finer than it resolves: its noise is alike over neighbours, as recorded noise is.

Standard deviation of the filter; `offradar_ros.lab.simulation.physics` fits it to the same recordings.
"""

Spoil = Callable[[PolarScan, np.random.Generator], NDArray[np.uint8]]


def blocked(scan: PolarScan, rng: np.random.Generator, share: float) -> NDArray[np.uint8]:
    """A `share` of neighbouring azimuths, from a random one on, receives what is left of them at the far end: noise."""
    rows, bins = scan.power.shape
    hidden = (int(rng.integers(rows)) + np.arange(round(share * rows))) % rows
    far = scan.power[:, round(0.9 * bins) :]
    strangers = rng.integers(rows, size=(len(hidden), -(-bins // far.shape[1])))
    spoiled: NDArray[np.uint8] = scan.power.copy()
    spoiled[hidden] = far[strangers].reshape(len(hidden), -1)[:, :bins]
    return spoiled


def flooded(scan: PolarScan, rng: np.random.Generator, decibels: float) -> NDArray[np.uint8]:
    """Exponential noise, `decibels` above the far end's median, is added to the power; a byte is half a decibel."""
    power = scan.power
    floor = float(np.median(power[:, round(0.9 * power.shape[1]) :]))
    deviation = NOISE_CORRELATION_M / scan.range_resolution_m
    length = 2 * math.ceil(3.0 * deviation) + 1
    fields = [cv2.GaussianBlur(rng.standard_normal(power.shape), (length, 1), deviation) for _ in range(2)]
    noise = fields[0] ** 2 + fields[1] ** 2
    noise /= noise.mean()
    received = 10.0 ** (power / 20.0) + 10.0 ** ((floor / 2.0 + decibels) / 10.0) * noise
    return np.asarray(np.clip(np.rint(20.0 * np.log10(received)), 0, 255), np.uint8)


SPOILED: dict[str, Spoil] = {
    'blocked_25': lambda scan, rng: blocked(scan, rng, 0.25),
    'blocked_50': lambda scan, rng: blocked(scan, rng, 0.5),
    'flooded_10_db': lambda scan, rng: flooded(scan, rng, 10.0),
    'flooded_20_db': lambda scan, rng: flooded(scan, rng, 20.0),
    'flooded_30_db': lambda scan, rng: flooded(scan, rng, 30.0),
}


def require_recorded(folder: Path) -> None:
    """DataError where `folder` does not hold both recordings."""
    for name in (CLEAN, FOG):
        open_source(folder / name)


def measure_recorded(encoder: Encoder, folder: Path, seed: int) -> Json:
    """U of clean and of spoiled Oxford scans and of foggy RADIATE scans, by name; DataError where they are not there.

    `above_every_clean` is the share of the scans whose U exceeds that of every clean scan, `above_own` the share whose
    U exceeds that of the same scan before it was spoiled.
    """
    scans = _scans(folder / CLEAN)
    clean = _uncertainties(encoder, scans)
    found = {'clean': _told(clean, clean)}
    for name, spoil in SPOILED.items():
        rng = np.random.default_rng(seed)
        spoiled = _uncertainties(encoder, [dataclasses.replace(s, power=spoil(s, rng)) for s in scans])
        found[name] = _told(spoiled, clean) | {'above_own': float(np.mean(spoiled > clean))}
    found['fog'] = _told(_uncertainties(encoder, _scans(folder / FOG)), clean)
    return found


def _scans(folder: Path) -> list[PolarScan]:
    sequence = open_source(folder)
    return [sequence.scan(index) for index in range(len(sequence))]


def _uncertainties(encoder: Encoder, scans: Iterable[PolarScan]) -> NDArray[np.float64]:
    def uncertainty(scan: PolarScan) -> float:
        try:
            return encoder.encode(scan).uncertainty
        except RefusedInput:
            return float('inf')

    return np.array([uncertainty(scan) for scan in scans], np.float64)


def _told(values: NDArray[np.float64], clean: NDArray[np.float64]) -> Json:
    return {
        'scans': len(values),
        'mean': float(values.mean()),
        'least': float(values.min()),
        'greatest': float(values.max()),
        'above_every_clean': float(np.mean(values > clean.max())),
    }
