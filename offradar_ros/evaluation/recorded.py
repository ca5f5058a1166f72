"""U of recorded scans, as they are and spoiled on their bytes: does what was learned in simulation hold outside it?"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.datasets.registry import open_sequence
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.evaluation.summary import Json
from offradar_ros.types import PolarScan

CLEAN = 'oxford_tiny'
FOG = 'radiate_tiny_foggy'
"""Folders of recorded drives: Oxford Radar RobotCar in clear weather, RADIATE in fog."""

Spoil = Callable[[NDArray[np.uint8], np.random.Generator], NDArray[np.uint8]]


def blocked(power: NDArray[np.uint8], rng: np.random.Generator, share: float) -> NDArray[np.uint8]:
    """A `share` of neighbouring azimuths, from a random one on, receives what is left of them at the far end: noise."""
    rows = (int(rng.integers(len(power))) + np.arange(round(share * len(power)))) % len(power)
    far = power[:, round(0.9 * power.shape[1]) :].reshape(-1)
    spoiled: NDArray[np.uint8] = power.copy()
    spoiled[rows] = rng.choice(far, (len(rows), power.shape[1]))
    return spoiled


def flooded(power: NDArray[np.uint8], rng: np.random.Generator, decibels: float) -> NDArray[np.uint8]:
    """Exponential noise, `decibels` above the far end's median, is added to the power; a byte is half a decibel."""
    floor = float(np.median(power[:, round(0.9 * power.shape[1]) :]))
    noise = 10.0 ** ((floor / 2.0 + decibels) / 10.0) * rng.standard_exponential(power.shape)
    received = 10.0 ** (power / 20.0) + noise
    return np.asarray(np.clip(np.rint(20.0 * np.log10(received)), 0, 255), np.uint8)


SPOILED: dict[str, Spoil] = {
    'blocked_25': lambda power, rng: blocked(power, rng, 0.25),
    'blocked_50': lambda power, rng: blocked(power, rng, 0.5),
    'flooded_10_db': lambda power, rng: flooded(power, rng, 10.0),
    'flooded_20_db': lambda power, rng: flooded(power, rng, 20.0),
}


def require_recorded(folder: Path) -> None:
    """DataError where `folder` does not hold both recordings."""
    for name in (CLEAN, FOG):
        open_sequence(folder / name)


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
        spoiled = _uncertainties(encoder, [dataclasses.replace(s, power=spoil(s.power, rng)) for s in scans])
        found[name] = _told(spoiled, clean) | {'above_own': float(np.mean(spoiled > clean))}
    found['fog'] = _told(_uncertainties(encoder, _scans(folder / FOG)), clean)
    return found


def _scans(folder: Path) -> list[PolarScan]:
    sequence = open_sequence(folder)
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
