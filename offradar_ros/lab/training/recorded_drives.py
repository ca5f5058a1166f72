"""Recorded drives of a training configuration, listed one by one or by a split."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.drives.recorded import RecordedDrive
from offradar_ros.lab.training.config import DataConfig, ValidationConfig
from offradar_ros.recordings.datasets.splits import Split, read_split
from offradar_ros.recordings.road import shared_frames, start_of
from offradar_ros.recordings.source import is_recording


class TrainingSequences(NamedTuple):
    """The training sequences of a split.

    Attributes:
        split: the split.
        found: bags or folders of its training sequences.
        missing: names of training sequences that are not there or have no scans.
    """

    split: Split
    found: list[Path]
    missing: list[str]


def training_sequences(config: DataConfig) -> TrainingSequences | None:
    """Those of `config.split`; None without a split. ConfigError for an unknown split, DataError if none is found."""
    if not config.split:
        if config.root:
            raise ConfigError(f'key data.split: expected the split whose sequences are in data.root, {config.root}')
        return None
    split = read_split(config.split)
    if not config.root:
        raise ConfigError(f'key data.root: expected the folder that holds the sequences of split {split.name}')
    root = Path(config.root)
    if not root.is_dir():
        raise DataError(f'{root}: no such folder: expected the sequences of split {split.name} in it (data.root)')
    found = [root / name for name in split.train if is_recording(root / name)]
    missing = [name for name in split.train if root / name not in found]
    if not found:
        raise DataError(f'{root}: none of the {len(missing)} training sequences of split {split.name} is there')
    return TrainingSequences(split, found, missing)


def recorded_drives(config: DataConfig | ValidationConfig) -> list[RecordedDrive]:
    """The drives of `config`; those of a split without the scans in its test region and its buffer.

    Drives that start within 50 km of each other share a world; a drive with metric positions is a separate world.
    DataError for a drive without positions.
    """
    drives = _drives([Path(path) for path in config.sequences], config.sequence_spacing_m)
    sequences = training_sequences(config) if isinstance(config, DataConfig) else None
    if sequences:
        drives += _drives(sequences.found, config.sequence_spacing_m, sequences.split)
    return drives


def _drives(paths: Sequence[Path], spacing_m: float, split: Split | None = None) -> list[RecordedDrive]:
    starts = [start_of(path) for path in paths]
    return [
        RecordedDrive(
            name=start.name,
            path=str(start.path),
            world=str(first.path),
            origin=dataclasses.astuple(first.origin) if first.origin else None,
            spacing_m=spacing_m,
            split=split,
        )
        for start, first in zip(starts, shared_frames(starts), strict=True)
    ]
