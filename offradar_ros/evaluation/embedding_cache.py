"""Embeddings of drives on disk, so that an evaluation goes on where it stopped.

``MODEL/DRIVE.means.npy`` is (N, d) float32, or float16 for descriptors of more than 4096 numbers;
``MODEL/DRIVE.uncertainty.npy`` is (N,) float64 and written last. A scan that the encoder refuses has no descriptor
(NaN) and the highest uncertainty there is (infinite).
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.network_image import make_image
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.evaluation.scan_cache import CachedDrive

BATCH = 16
LONG = 4096
"""Longer descriptors are kept in half precision: signed square roots of unit length lose nothing that matters."""

Row = tuple[NDArray[np.float32], float]
Progress = Callable[[int, int], None]


@dataclasses.dataclass(frozen=True, eq=False)
class EmbeddedDrive:
    """A drive and what an encoder made of it: `means` (N, d) float32, `uncertainties` (N,) float64."""

    drive: CachedDrive
    means: NDArray[np.float32]
    uncertainties: NDArray[np.float64]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N,) whether a scan has a descriptor."""
        return np.isfinite(self.uncertainties)


def embedded(encoder: Encoder, drive: CachedDrive, folder: Path, progress: Progress) -> EmbeddedDrive:
    """The drive's embeddings, from `folder` or made and kept there."""
    place = folder / encoder.info.fingerprint[:16]
    means_path, uncertainty_path = (place / f'{drive.key}.{part}.npy' for part in ('means', 'uncertainty'))
    if uncertainty_path.is_file():
        try:
            means = np.load(means_path, allow_pickle=False).astype(np.float32)
            return EmbeddedDrive(drive, means, np.load(uncertainty_path, allow_pickle=False))
        except (OSError, ValueError, EOFError) as error:
            raise DataError(
                f'{means_path}: damaged embeddings ({error}): remove them to have them made again'
            ) from None
    made = encode(encoder, drive, progress)
    kept = made.means if encoder.info.dimension <= LONG else made.means.astype(np.float16)
    place.mkdir(parents=True, exist_ok=True)
    _write(means_path, kept)
    _write(uncertainty_path, made.uncertainties)
    return dataclasses.replace(made, means=kept.astype(np.float32))


def encode(encoder: Encoder, drive: CachedDrive, progress: Progress) -> EmbeddedDrive:
    """Every scan of a drive; those that the encoder refuses, or gives anything but finite numbers for, are unusable."""
    means = np.full((len(drive), encoder.info.dimension), np.nan, np.float32)
    uncertainties = np.full(len(drive), np.inf)
    rows = _in_batches(encoder, drive) if isinstance(encoder, ImageEncoder) else _one_by_one(encoder, drive)
    for index, row in enumerate(rows):
        if row is not None and np.isfinite(row[0]).all() and np.isfinite(row[1]):
            means[index], uncertainties[index] = row
        progress(index + 1, len(drive))
    return EmbeddedDrive(drive, means, uncertainties)


def _one_by_one(encoder: Encoder, drive: CachedDrive) -> Iterator[Row | None]:
    def row(index: int) -> Row | None:
        try:
            embedding = encoder.encode(drive.scan(index))
        except RefusedInput:
            return None
        return embedding.mean, embedding.uncertainty

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(row, range(len(drive)))


def _in_batches(encoder: ImageEncoder, drive: CachedDrive) -> Iterator[Row | None]:
    to_image = make_image(encoder.header.config)
    for start in range(0, len(drive), BATCH):
        images = np.stack([to_image(drive.scan(i)) for i in range(start, min(start + BATCH, len(drive)))])
        means, variances = encoder.infer(images)
        for image, mean, variance in zip(images, means, variances, strict=True):
            yield (mean, float(np.mean(variance, dtype=np.float64))) if image.any() else None


def _write(path: Path, array: NDArray[np.generic]) -> None:
    partial = path.with_suffix(f'.{os.getpid()}.partial.npy')
    np.save(partial, array, allow_pickle=False)
    partial.replace(path)
