"""Images of cached scans, made by several threads while the network trains."""

from __future__ import annotations

import collections
import concurrent.futures
import contextlib
import os
import threading
from collections.abc import Generator, Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.network_image import make_image
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.batches import Batch, BatchSampler
from offradar_ros.lab.training.receiver_changes import with_changes
from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan


class ImageMaker:
    """Makes images for one network. Each thread has separate tables for each size of scan."""

    def __init__(self, config: NetworkConfig) -> None:
        self.config = config
        self._local = threading.local()

    def __call__(self, scan: PolarScan) -> NDArray[np.uint8]:
        """The network's image of a scan, uint8."""
        makers = self._local.__dict__
        key = (
            f'{scan.range_resolution_m} {scan.range_offset_m} {scan.power.shape[1]} {hash(scan.azimuths_rad.tobytes())}'
        )
        if key not in makers:
            makers[key] = make_image(self.config)
        image: NDArray[np.uint8] = makers[key](scan)
        return image


class ImageBatch(NamedTuple):
    """A batch with its images.

    Attributes:
        step: number of the batch.
        images: (2m, H, W) uint8.
        batch: the scans of the images.
    """

    step: int
    images: torch.Tensor
    batch: Batch


def image_batches(
    sampler: BatchSampler, config: NetworkConfig, steps: Sequence[int], threads: int = 0, pinned: bool = False
) -> Generator[ImageBatch, None, None]:
    """Batches of `steps`, in order, prefetched by `threads` (0: one per core), in `pinned` memory for a GPU."""
    threads = threads or len(os.sched_getaffinity(0))
    to_image = ImageMaker(config)

    def make(step: int) -> ImageBatch:
        batch = sampler.batch(step)
        first = _image(sampler, to_image, batch, 0)
        images = np.empty((len(batch.scans), *first.shape), np.uint8)
        images[0] = first
        for view in range(1, len(images)):
            images[view] = _image(sampler, to_image, batch, view)
        tensor = torch.from_numpy(images)
        return ImageBatch(step, tensor.pin_memory() if pinned else tensor, batch)

    with _single_threaded_opencv(), concurrent.futures.ThreadPoolExecutor(threads, 'images') as pool:
        waiting: collections.deque[concurrent.futures.Future[ImageBatch]] = collections.deque()
        try:
            for step in steps:
                waiting.append(pool.submit(make, step))
                if len(waiting) > threads + 1:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _image(sampler: BatchSampler, to_image: ImageMaker, batch: Batch, view: int) -> NDArray[np.uint8]:
    scan = batch.scans[view]
    drive = sampler.drives[sampler.drive_of[scan]]
    turned = spin(drive.scan(int(sampler.row_of[scan])), int(batch.spins[view]))
    return to_image(with_changes(turned, batch.changes[view]))


def images_of(drive: Drive, config: NetworkConfig, threads: int = 0) -> NDArray[np.uint8]:
    """(N, H, W) uint8 images of the N scans of a drive, not rotated."""
    to_image = ImageMaker(config)
    with (
        _single_threaded_opencv(),
        concurrent.futures.ThreadPoolExecutor(threads or len(os.sched_getaffinity(0))) as pool,
    ):
        return np.stack(list(pool.map(lambda row: to_image(drive.scan(row)), range(len(drive)))))


@contextlib.contextmanager
def _single_threaded_opencv() -> Iterator[None]:
    """Switch off the threads of OpenCV, which would compete with ours for the cores."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
