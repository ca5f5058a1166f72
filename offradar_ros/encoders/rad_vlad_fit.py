"""Fits the centres of FFT-RadVLAD to recorded or simulated scans by k-means."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from offradar_ros.encoders.k_means import k_means, nearest_centres
from offradar_ros.encoders.rad_vlad_codebook import MIN_REPETITION, Codebook, repetition
from offradar_ros.encoders.rad_vlad_rows import RowSettings, spectrum_rows
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.types import PolarScan


def fit_rad_vlad(
    scans: Iterable[PolarScan],
    seed: int,
    *,
    centres: int = 64,
    rows: RowSettings | None = None,
    rows_per_scan: int = 100,
    description: str = '',
) -> Codebook:
    """Centres of the scans' azimuth spectra.

    The authors fit all rows of the map that is searched. Here `rows_per_scan` random rows (2 or more) of each scan are
    used, and one codebook serves many maps. Without `rows` the spectra cover the range of the first scan. Scans without
    power are skipped; DataError if fewer rows remain than centres.
    """
    rng = np.random.default_rng(seed)
    kept = []
    for scan in scans:
        rows = rows or RowSettings(max_range_m=scan.max_range_m)
        try:
            spectra = spectrum_rows(scan, rows)
        except RefusedInput:
            continue
        kept.append(rng.permutation(spectra)[: max(2, rows_per_scan)].astype(np.float32))
    found = sum(map(len, kept))
    if rows is None or found < centres:
        raise DataError(f'rad_vlad: expected scans of {centres} azimuths or more to fit as many centres, got {found}')
    points = np.concatenate(kept)
    fitted = k_means(points, centres, seed)
    typical = np.mean([repetition(np.bincount(nearest_centres(scan, fitted)[0])) for scan in kept])
    return Codebook(rows, fitted, max(float(typical), MIN_REPETITION), description)
