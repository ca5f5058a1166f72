"""Which sequences are trained on and which are tested, as data: ``params/splits/NAME.yaml`` holds these records."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import ConfigError
from offradar_ros.recordings.datasets.region import Region
from offradar_ros.records import read_record
from offradar_ros.shipped import shipped_file


@dataclasses.dataclass(frozen=True)
class Split:
    """A data set divided into test and training sequences.

    Attributes:
        name: stable, in results.
        title: for people.
        source: where the division is published, and which part of it is a substitute.
        test: folder names of the test sequences, from which no scan is trained on.
        train: folder names of the training sequences.
        region: where it is tested; without a region everywhere, and then no scan of `train` is left out.
        buffer_m: scans of `train` this near to the region are left out of training.
    """

    name: str
    title: str
    source: str
    test: tuple[str, ...]
    train: tuple[str, ...]
    region: Region = dataclasses.field(default_factory=Region)
    buffer_m: float = 50.0

    def __post_init__(self) -> None:
        for key in ('test', 'train'):
            names = getattr(self, key)
            if not names:
                raise ConfigError(f'key {key}: expected at least one sequence')
            odd = next((name for name in names if name in ('', '.', '..') or Path(name).name != name), None)
            if odd is not None:
                raise ConfigError(f'key {key}: expected names of folders, got {odd!r}')
        listed = (*self.test, *self.train)
        twice = next((name for name in listed if listed.count(name) > 1), None)
        if twice is not None:
            raise ConfigError(f'sequence {twice}: expected once, in test or in train')
        if not 0.0 <= self.buffer_m < math.inf:
            raise ConfigError(f'key buffer_m: expected metres from 0, got {self.buffer_m:g}')

    def tested(self, points_lla: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) bool: which scans of a test sequence, at (N, 3) latitude°, longitude°, altitude m, are tested.

        A scan whose position is not finite is not tested.
        """
        outside_m = self.region.outside_m(points_lla)
        return outside_m <= 0.0 if self.region else ~np.isnan(outside_m)

    def trainable(self, points_lla: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) bool: which scans of a training sequence may be trained on; none whose position is not finite."""
        return np.asarray(self.region.outside_m(points_lla) > self.buffer_m)


def read_split(source: str | Path) -> Split:
    """The split in a YAML file, or of a name in ``params/splits``; ConfigError says what was expected."""
    return read_record(Split, shipped_file('splits', source))
