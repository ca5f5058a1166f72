"""Embeddings of a whole sequence, in batches where the encoder takes several images at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.sequence import RadarSequence

BATCH = 16
"""Images at once, on any device: enough to keep a GPU busy, few enough for the activations of VGG-16 in main memory."""


def encode_all(
    encoder: Encoder, sequence: RadarSequence, progress: Callable[[int, int], None] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Means and variances, both (N, d) float32, of all N scans in order.

    A scan that is refused, by the sequence or by the encoder, has NaN in its row of both: so it counts as a scan, and
    whoever compares embeddings refuses it again. `progress` is told (done, N) as it goes. DataError as the sequence
    raises it.
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
