"""Data-set folders written to test with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.radar.navtech_rows import join_rows
from offradar_ros.types import PolarScan

START_US = 1_547_131_046_000_000
PERIOD_US = 250_000


def synthetic_scan(stamp_ns: int, bins: int = 3768, rows: int = 400) -> PolarScan:
    power = np.random.default_rng(stamp_ns % 2**32).integers(1, 256, (rows, bins)).astype(np.uint8)
    return PolarScan(
        stamp_ns,
        power,
        np.arange(rows, dtype=np.float64) * (2 * np.pi / rows),
        0.0432,
        azimuth_stamps_ns=stamp_ns + np.arange(rows, dtype=np.int64) * 625_000,
    )


def write_png(path: Path, image: NDArray[np.uint8]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode('.png', image, [cv2.IMWRITE_PNG_COMPRESSION, 0])[1].tobytes())


def metadata_image(scan: PolarScan, *, microseconds: bool) -> NDArray[np.uint8]:
    image = join_rows(scan, 5600)
    if microseconds and scan.azimuth_stamps_ns is not None:
        image[:, :8] = (scan.azimuth_stamps_ns // 1000).astype('<i8').reshape(-1, 1).view(np.uint8)
    return image


@pytest.fixture
def oxford_folder(tmp_path: Path) -> Path:
    """Six Oxford scans with radar.timestamps and gps.csv that covers them."""
    root = tmp_path / '2019-01-10-14-36-48-radar-oxford-10k'
    stamps = [START_US + PERIOD_US * k for k in range(6)]
    for stamp in stamps:
        image = metadata_image(synthetic_scan(stamp * 1000), microseconds=True)
        write_png(root / 'radar' / f'{stamp}.png', image)
    (root / 'radar.timestamps').write_text(''.join(f'{stamp} 1\n' for stamp in stamps))
    (root / 'gps').mkdir()
    rows = [f'{START_US - 1_000_000 + 200_000 * k},51.76{k:03d},-1.26,65.0' for k in range(20)]
    (root / 'gps' / 'gps.csv').write_text('\n'.join(['timestamp,latitude,longitude,altitude', *rows]) + '\n')
    return root


@pytest.fixture
def scan_writers() -> dict[str, Callable[..., Any]]:
    """Functions that make scans and write them as files."""
    return {'scan': synthetic_scan, 'png': write_png, 'metadata': metadata_image}
