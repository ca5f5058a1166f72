"""How the ring key's U answers to spoiled scans: see README.md beside this file."""

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
    """A share of neighbouring azimuths receives nothing but a little noise."""
    spoiled: Power = power.copy()
    rows = round(share * len(power))
    spoiled[:rows] = np.minimum(power[:rows], rng.integers(0, 20, (rows, power.shape[1])))
    return spoiled


def muddy(power: Power, share: float, rng: np.random.Generator) -> Power:
    """As blocked, and the dirt shows as strong returns over the nearest thirtieth of the range."""
    spoiled, rows, near = blocked(power, share, rng), round(share * len(power)), power.shape[1] // 30
    spoiled[:rows, :near] = np.maximum(spoiled[:rows, :near], rng.integers(80, 160, (rows, near)))
    return spoiled


def flooded(power: Power, level: float, rng: np.random.Generator) -> Power:
    """Exponential noise of this mean is added everywhere."""
    return _clipped(power + rng.exponential(level, power.shape))


def streaked(power: Power, share: float, rng: np.random.Generator) -> Power:
    """A share of the azimuths, here and there, is saturated from some range outwards."""
    spoiled: Power = power.copy()
    for row in rng.choice(len(power), round(share * len(power)), replace=False):
        start = int(rng.integers(0, power.shape[1] // 4))
        spoiled[row, start:] = np.maximum(power[row, start:], rng.integers(180, 256))
    return spoiled


def rained(power: Power, steps: float, rng: np.random.Generator) -> Power:
    """Power falls by this much more at the far end, down to the noise that the scan has there."""
    far = power[:, round(0.85 * power.shape[1]) :].reshape(-1)
    fall = steps * np.arange(power.shape[1]) / power.shape[1]
    return _clipped(np.maximum(power - fall, rng.choice(far, power.shape)))


def overdriven(power: Power, gain: float, rng: np.random.Generator) -> Power:
    """Every reading times this gain, up to what the sensor can say."""
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
                spoiled = [dataclasses.replace(s, power=fault(s.power, severity, rng)) for s in scans]
                found = uncertainties(spoiled) / clean
                cells.append(f'{severity:g}: {found.mean():.2f}{"" if (found > 1.0).all() else "!"}')
            print(f'  {fault.__name__:10} ' + '  '.join(f'{cell:10}' for cell in cells).rstrip(), flush=True)


if __name__ == '__main__':
    main()
