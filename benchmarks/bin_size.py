"""Whether the size of a range bin can be found out from scans: see README.md."""

from __future__ import annotations

import csv
import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from recorded_answers import encode, print_head, print_row
from recorded_scans import BAY_BINS, bay_sessions, evenly_spaced
from scan_registration import Registration, strongest
from scan_sources import read_arguments, recorded_sources

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.types import PolarScan

FACTORS = (0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
"""Sizes that are tried, over the true one; over 1 m, where that is not known."""
_REACH_M = 25.0
_NEAREST = 0.02
"""Share of the range that holds returns of the vehicle."""


def with_bins_of(scan: PolarScan, factor: float) -> PolarScan:
    """The scan with bins that many times as large."""
    return dataclasses.replace(scan, range_resolution_m=scan.range_resolution_m * factor)


def correlation_length_bins(scans: Sequence[PolarScan]) -> float:
    """Lag along range at which the autocorrelation of the scans' rows, each minus its mean, falls to a half."""
    total = np.zeros(0)
    for scan in scans:
        power = scan.power[:, round(_NEAREST * scan.power.shape[1]) :].astype(np.float64)
        power -= power.mean(axis=1, keepdims=True)
        bins = power.shape[1]
        spectrum = np.abs(np.fft.rfft(power, 2 * bins, axis=1)) ** 2
        correlation = np.fft.irfft(spectrum.sum(axis=0))[:bins] / np.arange(bins, 0, -1)
        total = correlation / correlation[0] + (total if total.size else 0.0)
    mean = total / len(scans)
    after = int(np.flatnonzero(mean < 0.5)[0])
    return after - 1 + float((mean[after - 1] - 0.5) / (mean[after - 1] - mean[after]))


def uncertainty_and_change(encoder: Encoder, scans: Sequence[PolarScan]) -> tuple[float, float]:
    """Mean U, and mean distance between the embeddings of successive scans (NaN for one scan)."""
    embeddings = encode(encoder, scans)
    changes = [float(np.linalg.norm(b.mean - a.mean)) for a, b in itertools.pairwise(embeddings)]
    return float(np.mean([scan.uncertainty for scan in embeddings])), float(np.mean(changes)) if changes else np.nan


def odometry_m(path: Path, scans: Sequence[PolarScan]) -> float:
    """Metres forward between the first and the last scan, of Oxford's file of motions between successive scans."""
    first_us, last_us = (scan.stamp_ns // 1000 for scan in (scans[0], scans[-1]))
    with path.open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    return sum(float(row['x']) for row in rows if first_us < int(row['source_radar_timestamp']) <= last_us)


def followed_m(scans: Sequence[PolarScan]) -> float:
    """Metres forward between the first and the last scan, by correlation of scans."""
    loud = [strongest(scan, 0.1) for scan in scans]
    return list(Registration(_REACH_M, 3.0).follow(loud, loud[0]))[-1].forward_m


def main() -> None:
    """Print tables in Markdown."""
    real = read_arguments(__doc__ or '').real
    known = dict(recorded_sources(real, 18))
    bay = {f'bay, session {number}': power[::6, :, :BAY_BINS] for number, power in bay_sessions(real).items()}
    scans = known | {name: evenly_spaced(power, 1.0) for name, power in bay.items()}
    encoder = make_encoder(EncoderConfig())
    print_head('recording', 'bin', 'correlation length', *(f'U at {factor:g}' for factor in FACTORS))
    changes: dict[str, list[float]] = {}
    for name, found in scans.items():
        both = [uncertainty_and_change(encoder, [with_bins_of(scan, factor) for scan in found]) for factor in FACTORS]
        changes[name] = [change for _, change in both]
        length = correlation_length_bins(found)
        bin_m = found[0].range_resolution_m
        sizes = (f'{bin_m:.4f} m', f'{length * bin_m:.2f} m') if name in known else ('–', f'{length:.2f} bins')
        print_row(name, *sizes, *(f'{u:.2f}' for u, _ in both))
    print_head('distance of successive scans', *(f'at {factor:g}' for factor in FACTORS))
    for name, values in changes.items():
        if not np.isnan(values[0]):
            print_row(name, *(f'{value:.2f}' for value in values))
    drive = known['oxford_tiny']
    driven_m, seen_m = odometry_m(real / 'oxford_tiny' / 'gt' / 'radar_odometry.csv', drive), followed_m(drive)
    found_m = drive[0].range_resolution_m * driven_m / seen_m
    print(f'\noxford_tiny: {driven_m:.1f} m driven, {seen_m:.1f} m by correlation: bins of {found_m:.4f} m')


if __name__ == '__main__':
    main()
