"""What makes an embedding unusable, for the map and for a query alike."""

from __future__ import annotations

import numpy as np

from offradar_ros.mapping.place_check import MAX_MEAN_VALUE
from offradar_ros.positions.rules import END_NS
from offradar_ros.types import MAX_SIGNATURE_BYTES, Embedding


def embedding_problem(embedding: Embedding) -> str | None:
    """Why `embedding` can neither be mapped nor be searched with, in one line; None if it is valid."""
    mean, variance = embedding.mean, embedding.variance
    if mean.ndim != 1 or variance.ndim != 1 or mean.size == 0 or mean.size != variance.size:
        return f'expected mean and variance of one equal length, got shapes {mean.shape} and {variance.shape}'
    for name, values in (('mean', mean), ('variance', variance)):
        wrong = int(np.count_nonzero(~np.isfinite(values)))
        if wrong:
            return f'{wrong} of {values.size} values of the {name} are NaN or infinite'
    if float(np.abs(mean).max()) > MAX_MEAN_VALUE:
        return f'the mean holds a value beyond ±{MAX_MEAN_VALUE:g}'
    if not 0 <= embedding.stamp_ns < END_NS:
        return f'its stamp is not from 0 to {END_NS} ns'
    if float(variance.min()) < 0.0:
        return f'the variance holds a negative value, {float(variance.min()):g}'
    if len(embedding.signature) > MAX_SIGNATURE_BYTES:
        return f'its signature has {len(embedding.signature)} bytes, more than {MAX_SIGNATURE_BYTES}'
    return None
