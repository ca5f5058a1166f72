"""Embeddings of a whole sequence, in batches if the encoder takes several images at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.sequence import RadarSequence

BATCH = 16
"""Images in a batch: enough to keep a GPU busy, and few enough for the activations of VGG-16 in main memory."""


def encode_all(
    encoder: Encoder, sequence: RadarSequence, progress: Callable[[int, int], None] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Means and variances, both (N, d) float32, of all N scans in order.

    Rows of scans that the sequence or the encoder refuses are NaN in both: such a scan is counted, and refused again
    where embeddings are compared. `progress` is called with (done, N). DataError as raised by the sequence.
    """
    total = len(sequence)
    means = np.full((total, encoder.info.dimension), np.nan, np.float32)
    variances = means.copy()
    for start in range(0, total, BATCH):
        indices = range(start, min(start + BATCH, total))
        if isinstance(encoder, ImageEncoder):
            _encode_together(encoder, sequence, indices, means, variances)
        else:
            _encode_singly(encoder, sequence, indices, means, variances)
        if progress is not None:
            progress(indices.stop, total)
    return means, variances


def _encode_together(
    encoder: ImageEncoder,
    sequence: RadarSequence,
    indices: range,
    means: NDArray[np.float32],
    variances: NDArray[np.float32],
) -> None:
    rows, images = [], []
    for index in indices:
        try:
            images.append(encoder.image(sequence.scan(index)))
        except RefusedInput:
            continue
        rows.append(index)
    if rows:
        means[rows], variances[rows] = encoder.infer(np.stack(images))


def _encode_singly(
    encoder: Encoder,
    sequence: RadarSequence,
    indices: range,
    means: NDArray[np.float32],
    variances: NDArray[np.float32],
) -> None:
    for index in indices:
        try:
            embedding = encoder.encode(sequence.scan(index))
        except RefusedInput:
            continue
        means[index], variances[index] = embedding.mean, embedding.variance
