"""The training sequences of a split that are on this machine, as drives."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.training.config import DataConfig
from offradar_ros.lab.training.recorded_drives import RecordedDrive, recorded_drives
from offradar_ros.recordings.datasets.splits import Split, read_split
from offradar_ros.recordings.source import is_recording


class TrainingSequences(NamedTuple):
    """Attributes: what of a split can be trained on here.

    split: the split.
    found: bags or folders of its training sequences.
    missing: names of those that are not there, or hold no scans.
    """

    split: Split
    found: list[Path]
    missing: list[str]


def training_sequences(config: DataConfig) -> TrainingSequences | None:
    """What `config` names; None without a split. ConfigError for an unknown one, DataError where nothing is there."""
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


def split_drives(config: DataConfig) -> list[RecordedDrive]:
    """Their drives, without the scans in the split's test region or its buffer; none without a split."""
    sequences = training_sequences(config)
    if sequences is None:
        return []
    return recorded_drives(list(map(str, sequences.found)), config.sequence_spacing_m, sequences.split)
