"""Embeddings of drives on disk, so that an interrupted evaluation continues where it stopped.

``MODEL/DRIVE.means.npy`` is (N, d) float32, or float16 for descriptors of more than 4096 numbers;
``MODEL/DRIVE.uncertainty.npy`` is (N,) float64 and written last. A scan that the encoder refuses has a descriptor
of NaN and an infinite uncertainty. A drive of more than `BLOCK` scans is kept in blocks until it is complete.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.encode import encode_all
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.lab.array_file import read_array, write_array
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.processes import Progress
from offradar_ros.types import Embedding

BLOCK = 1024
"""Most scans that are encoded again after an interruption."""

LONG = 4096
"""Longer descriptors are kept in half precision: signed square roots of unit length lose nothing that matters."""


@dataclasses.dataclass(frozen=True, eq=False)
class EmbeddedDrive:
    """A drive and its embeddings: `means` (N, d) float32, `uncertainties` (N,) float64."""

    drive: Drive
    means: NDArray[np.float32]
    uncertainties: NDArray[np.float64]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N,) whether a scan has a descriptor."""
        return np.isfinite(self.uncertainties)


def cached_embeddings(encoder: Encoder, drive: Drive, folder: Path, progress: Progress) -> EmbeddedDrive:
    """The embeddings of a drive: read from `folder`, or encoded and kept there, a long drive block by block.

    DataError where the folder cannot be made or written, or holds damaged embeddings.
    """
    place = folder / encoder.info.fingerprint[:16]
    kept = _load(drive, place, drive.key)
    if kept:
        return kept
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{place}: expected a folder for embeddings ({error.strerror})') from None
    starts = range(0, len(drive), BLOCK)
    blocks = [_block(encoder, drive, start, place, progress) for start in starts]
    made = EmbeddedDrive(
        drive,
        np.concatenate([block.means for block in blocks]),
        np.concatenate([block.uncertainties for block in blocks]),
    )
    _keep(made, place, drive.key)
    for start in starts:
        for path in _paths(place, _block_key(drive, start)):
            path.unlink(missing_ok=True)
    return _load(drive, place, drive.key) or made


def _block(encoder: Encoder, drive: Drive, start: int, place: Path, progress: Progress) -> EmbeddedDrive:
    part = _part_of(drive, start)
    kept = _load(part, place, _block_key(drive, start))
    if kept is None:
        kept = encode_drive(encoder, part, lambda done, _: progress(start + done, len(drive)))
        if len(drive) > BLOCK:
            _keep(kept, place, _block_key(drive, start))
    progress(start + len(part), len(drive))
    return kept


def _part_of(drive: Drive, start: int) -> Drive:
    rows = slice(start, start + BLOCK)
    return dataclasses.replace(
        drive,
        stamps_ns=drive.stamps_ns[rows],
        poses=drive.poses[rows],
        driven_m=drive.driven_m[rows],
        kinds=drive.kinds[rows],
        severities=drive.severities[rows],
        read_scan=lambda row: drive.read_scan(start + row),
    )


def _block_key(drive: Drive, start: int) -> str:
    return f'{drive.key}.from_{start}'


def _paths(place: Path, key: str) -> tuple[Path, Path]:
    return place / f'{key}.means.npy', place / f'{key}.uncertainty.npy'


def _load(drive: Drive, place: Path, key: str) -> EmbeddedDrive | None:
    means_path, uncertainty_path = _paths(place, key)
    if not uncertainty_path.is_file():
        return None
    try:
        return EmbeddedDrive(drive, read_array(means_path).astype(np.float32), read_array(uncertainty_path))
    except (OSError, ValueError) as error:
        raise DataError(f'{means_path}: damaged embeddings ({error}): remove them, and they are made again') from None


def _keep(made: EmbeddedDrive, place: Path, key: str) -> None:
    means_path, uncertainty_path = _paths(place, key)
    _write(means_path, made.means if made.means.shape[1] <= LONG else made.means.astype(np.float16))
    _write(uncertainty_path, made.uncertainties)


def encode_drive(encoder: Encoder, drive: Drive, progress: Progress) -> EmbeddedDrive:
    """Encode every scan; one that the encoder refuses, or whose embedding is not finite, is unusable."""
    if isinstance(encoder, ImageEncoder):
        means, variances = encode_all(encoder, drive, progress)
        uncertainties = variances.mean(axis=1, dtype=np.float64)
    else:
        means, uncertainties = _in_parallel(encoder, drive, progress)
    usable = np.isfinite(means).all(axis=1) & np.isfinite(uncertainties)
    means[~usable], uncertainties[~usable] = np.nan, np.inf
    return EmbeddedDrive(drive, means, uncertainties)


def _in_parallel(encoder: Encoder, drive: Drive, progress: Progress) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Encode one scan on each core: encoders without a network have no batches."""
    means = np.full((len(drive), encoder.info.dimension), np.nan, np.float32)
    uncertainties = np.full(len(drive), np.nan)

    def encode_one(index: int) -> Embedding | None:
        try:
            return encoder.encode(drive.scan(index))
        except RefusedInput:
            return None

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for index, embedding in enumerate(pool.map(encode_one, range(len(drive)))):
            if embedding is not None:
                means[index], uncertainties[index] = embedding.mean, embedding.uncertainty
            progress(index + 1, len(drive))
    return means, uncertainties


def _write(path: Path, array: NDArray[np.generic]) -> None:
    try:
        write_array(path, array)
    except OSError as error:
        raise DataError(f'{path}: cannot be written ({error.strerror or error})') from error
