"""The U of the ring key for degraded scans: see README.md."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scan_sources import read_arguments, scan_sources

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.types import PolarScan

Power = NDArray[np.uint8]
SCANS = 6


def blocked(power: Power, share: float, rng: np.random.Generator) -> Power:
    """A share of the azimuths, all neighbours, holds weak noise."""
    degraded: Power = power.copy()
    rows = round(share * len(power))
    degraded[:rows] = np.minimum(power[:rows], rng.integers(0, 20, (rows, power.shape[1])))
    return degraded


def muddy(power: Power, share: float, rng: np.random.Generator) -> Power:
    """As blocked, with strong returns of the dirt in the nearest thirtieth of the range."""
    degraded, rows, near = blocked(power, share, rng), round(share * len(power)), power.shape[1] // 30
    degraded[:rows, :near] = np.maximum(degraded[:rows, :near], rng.integers(80, 160, (rows, near)))
    return degraded


def flooded(power: Power, level: float, rng: np.random.Generator) -> Power:
    """Exponential noise of this mean is added everywhere."""
    return _clipped(power + rng.exponential(level, power.shape))


def streaked(power: Power, share: float, rng: np.random.Generator) -> Power:
    """A random share of the azimuths is saturated beyond a random range."""
    degraded: Power = power.copy()
    for row in rng.choice(len(power), round(share * len(power)), replace=False):
        start = int(rng.integers(0, power.shape[1] // 4))
        degraded[row, start:] = np.maximum(power[row, start:], rng.integers(180, 256))
    return degraded


def rained(power: Power, steps: float, rng: np.random.Generator) -> Power:
    """Power falls linearly with range, by `steps` at the far end, but not below the noise there."""
    far = power[:, round(0.85 * power.shape[1]) :].reshape(-1)
    fall = steps * np.arange(power.shape[1]) / power.shape[1]
    return _clipped(np.maximum(power - fall, rng.choice(far, power.shape)))


def overdriven(power: Power, gain: float, rng: np.random.Generator) -> Power:
    """Power times a gain, clipped to a byte."""
    del rng
    return _clipped(power * gain)


def _clipped(power: NDArray[Any]) -> Power:
    return np.asarray(np.clip(power, 0, 255), np.uint8)


FAULTS: dict[Callable[[Power, float, np.random.Generator], Power], tuple[float, ...]] = {
    blocked: (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9),
    muddy: (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9),
    flooded: (5, 10, 20, 40, 80, 160),
    streaked: (0.02, 0.05, 0.1, 0.2, 0.4, 0.8),
    rained: (10, 20, 40, 80),
    overdriven: (2, 4, 8),
}


def uncertainties(scans: list[PolarScan]) -> NDArray[np.float64]:
    """U of each scan."""
    encoder = RingKeyEncoder(RingKeyConfig())
    return np.array([encoder.encode(scan).uncertainty for scan in scans])


def main() -> None:
    """Print a table for each source of scans."""
    arguments = read_arguments(__doc__ or '')
    for name, scans in scan_sources(arguments.real, SCANS):
        clean = uncertainties(scans)
        relative = clean / clean.mean()
        print(f'\n{name}: clean scans: {len(scans)}, U {relative.min():.2f} to {relative.max():.2f} about their mean')
        for fault, severities in FAULTS.items():
            cells = []
            for severity in severities:
                rng = np.random.default_rng(1)
                degraded = [dataclasses.replace(s, power=fault(s.power, severity, rng)) for s in scans]
                found = uncertainties(degraded) / clean
                cells.append(f'{severity:g}: {found.mean():.2f}{"" if (found > 1.0).all() else "!"}')
            print(f'  {fault.__name__:10} ' + '  '.join(f'{cell:10}' for cell in cells).rstrip(), flush=True)


if __name__ == '__main__':
    main()
