"""Fits the centres of FFT-RadVLAD to the training scans, without gradients."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from offradar_ros.encoders.rad_vlad_fit import fit_rad_vlad
from offradar_ros.encoders.rad_vlad_rows import RowSettings
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.records import write_record

SCANS = 2000
CENTRES_FILE = 'rad_vlad.safetensors'


def fit_centres(config: TrainingConfig, drives: Sequence[Drive], out: Path) -> Path:
    """Fit the centres, write them and the configuration into `out`, and return the file of the centres.

    They are fitted to spectra of at most `SCANS` random scans, up to the range of the network's image. DataError for
    too few scans, ModelError for a folder that cannot be written.
    """
    rng = np.random.default_rng(config.seed)
    rows = [(drive, row) for drive in drives for row in range(len(drive))]
    chosen = rng.permutation(len(rows))[:SCANS]
    codebook = fit_rad_vlad(
        (rows[index][0].scan(rows[index][1]) for index in chosen),
        config.seed,
        rows=RowSettings(max_range_m=config.network.reach_m, min_range_m=config.network.min_range_m),
        description=f'fitted to {len(chosen)} scans of {len(drives)} drives',
    )
    write_record(out / 'config.yaml', config)
    path = out / CENTRES_FILE
    codebook.save(path)
    return path
