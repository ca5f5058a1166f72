"""U of recorded scans, as recorded and with faults added to their bytes.

It shows whether U, learned in simulation, holds for a real radar. Scans of a recording in good conditions are taken to
be clean; faults are added to their bytes, and other recordings (in fog, with a dirty radome) are compared with them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import RadarConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import ConfigError, DataError, RefusedInput
from offradar_ros.lab.evaluation.results.uncertainty import ConditionFigures, RecordedUncertainty
from offradar_ros.lab.evaluation.runner import Bar
from offradar_ros.recordings.source import open_source
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

NOISE_CORRELATION_M = 0.165
"""Standard deviation of the filter that correlates noise over neighbouring range bins, as recorded noise is.

`offradar_ros.lab.simulation.physics` fits it to the same recordings.
"""

Degrade = Callable[[PolarScan, np.random.Generator], NDArray[np.uint8]]


def blocked(scan: PolarScan, rng: np.random.Generator, share: float) -> NDArray[np.uint8]:
    """Replace a `share` of the azimuths, neighbours from a random one on, by noise: power of the far range bins."""
    rows, bins = scan.power.shape
    hidden = (int(rng.integers(rows)) + np.arange(round(share * rows))) % rows
    far = scan.power[:, round(0.9 * bins) :]
    other_rows = rng.integers(rows, size=(len(hidden), -(-bins // far.shape[1])))
    degraded: NDArray[np.uint8] = scan.power.copy()
    degraded[hidden] = far[other_rows].reshape(len(hidden), -1)[:, :bins]
    return degraded


def flooded(scan: PolarScan, rng: np.random.Generator, decibels: float) -> NDArray[np.uint8]:
    """Add exponential noise, `decibels` above the median of the far range bins; a byte is half a decibel."""
    power = scan.power
    floor = float(np.median(power[:, round(0.9 * power.shape[1]) :]))
    deviation = NOISE_CORRELATION_M / scan.range_resolution_m
    length = 2 * math.ceil(3.0 * deviation) + 1
    fields = [cv2.GaussianBlur(rng.standard_normal(power.shape), (length, 1), deviation) for _ in range(2)]
    noise = fields[0] ** 2 + fields[1] ** 2
    noise /= noise.mean()
    received = 10.0 ** (power / 20.0) + 10.0 ** ((floor / 2.0 + decibels) / 10.0) * noise
    return np.asarray(np.clip(np.rint(20.0 * np.log10(received)), 0, 255), np.uint8)


DEGRADED: dict[str, Degrade] = {
    'blocked_25': lambda scan, rng: blocked(scan, rng, 0.25),
    'blocked_50': lambda scan, rng: blocked(scan, rng, 0.5),
    'flooded_10_db': lambda scan, rng: flooded(scan, rng, 10.0),
    'flooded_20_db': lambda scan, rng: flooded(scan, rng, 20.0),
    'flooded_30_db': lambda scan, rng: flooded(scan, rng, 30.0),
}


CLEAN = 'clean'
"""Condition of the scans as recorded."""


@dataclasses.dataclass(frozen=True)
class RecordedScans:
    """Recordings, data-set folders or bags, whose U is measured.

    ConfigError where a name in `compared` is that of another condition.

    Attributes:
        clean: a recording in good conditions.
        compared: other recordings, by the name of their condition.
        radar: how they are read.
    """

    clean: Path
    compared: Mapping[str, Path] = dataclasses.field(default_factory=dict)
    radar: RadarConfig = dataclasses.field(default_factory=RadarConfig)

    def __post_init__(self) -> None:
        taken = sorted({CLEAN, *DEGRADED} & set(self.compared))
        if taken:
            raise ConfigError(f'{taken[0]}: expected another name of a condition, this one is taken')

    def open(self) -> dict[str, RadarSequence]:
        """The clean recording and the others, by condition; DataError for one that cannot be read."""
        paths = {CLEAN: self.clean, **self.compared}
        return {name: open_source(path, 'auto', self.radar) for name, path in paths.items()}


def measure_recorded(encoders: Mapping[str, Encoder], scans: RecordedScans, seed: int, bar: Bar) -> RecordedUncertainty:
    """U by method and condition; DataError for recordings that cannot be read. Unreadable scans are left out."""
    sequences = scans.open()
    names = {condition: path.resolve().name for condition, path in scans.compared.items()}
    methods = {}
    for name, encoder in encoders.items():
        total = len(DEGRADED) * len(sequences[CLEAN]) + sum(map(len, sequences.values()))
        with bar(f'{name}: recorded scans') as progress:
            methods[name] = _conditions(encoder, sequences, seed, _Counter(progress, total))
    return RecordedUncertainty(scans.clean.resolve().name, names, methods)


def _conditions(
    encoder: Encoder, sequences: Mapping[str, RadarSequence], seed: int, count: Callable[[], None]
) -> dict[str, ConditionFigures]:
    clean = _uncertainties(encoder, sequences[CLEAN], count)
    found = {CLEAN: _figures(clean, clean, math.nan)}
    for name, degrade in DEGRADED.items():
        degraded = _uncertainties(encoder, sequences[CLEAN], count, degrade, np.random.default_rng(seed))
        found[name] = _figures(degraded, clean, float(np.mean(degraded > clean)))
    for name, sequence in sequences.items():
        if name != CLEAN:
            found[name] = _figures(_uncertainties(encoder, sequence, count), clean, math.nan)
    return found


class _Counter:
    """Reports progress by one scan at each call."""

    def __init__(self, progress: Callable[[int, int], None], total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def __call__(self) -> None:
        self._done += 1
        self._progress(self._done, self._total)


def _uncertainties(
    encoder: Encoder,
    sequence: RadarSequence,
    count: Callable[[], None],
    degrade: Degrade | None = None,
    rng: np.random.Generator | None = None,
) -> NDArray[np.float64]:
    """(N,) U of each readable scan, infinite where the encoder refuses it; DataError where none can be read."""
    found = []
    for index in range(len(sequence)):
        count()
        try:
            scan = sequence.scan(index)
        except (DataError, RefusedInput):
            continue
        if degrade and rng:
            scan = dataclasses.replace(scan, power=degrade(scan, rng))
        found.append(_uncertainty(encoder, scan))
    if not found:
        raise DataError(f'{sequence.name}: expected recorded scans, none can be read')
    return np.array(found, np.float64)


def _uncertainty(encoder: Encoder, scan: PolarScan) -> float:
    try:
        return encoder.encode(scan).uncertainty
    except RefusedInput:
        return math.inf


def _figures(values: NDArray[np.float64], clean: NDArray[np.float64], above_own: float) -> ConditionFigures:
    return ConditionFigures(
        scans=len(values),
        mean=float(values.mean()),
        least=float(values.min()),
        greatest=float(values.max()),
        above_every_clean=float(np.mean(values > clean.max())),
        above_own=above_own,
    )
