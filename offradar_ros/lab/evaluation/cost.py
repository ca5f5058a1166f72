"""What an encoder costs: time per scan, time per query, memory per place."""

from __future__ import annotations

import resource
import time

import numpy as np

from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.results.method import Cost
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import Embedding, Place, PlaceTable, Pose

SCANS = 20
"""Scans that are timed."""

WARM_UP = 3
"""Scans before them that are not."""


def measure_cost(encoder: Encoder, drive: Drive, places: int) -> Cost:
    """Medians over some scans of a drive, encoded one by one as a node does; reading the scan is not timed.

    `places` is the size of the map that is searched.
    """
    encoded_s: list[float] = []
    searched_s: list[float] = []
    index: PlaceIndex | None = None
    for row in np.linspace(0, len(drive) - 1, SCANS + WARM_UP).round().astype(int).tolist():
        try:
            scan = drive.scan(row)
            start_s = time.perf_counter()
            embedding = encoder.encode(scan)
        except RefusedInput:
            continue
        encoded_s.append(time.perf_counter() - start_s)
        index = index or _index(embedding, places)
        start_s = time.perf_counter()
        index.search(embedding.mean, 10)
        searched_s.append(time.perf_counter() - start_s)
    return Cost(
        encode_ms=_median_ms(encoded_s),
        search_ms=_median_ms(searched_s),
        bytes_per_place=4.0 * encoder.info.dimension,
        peak_memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    )


def _index(embedding: Embedding, places: int) -> PlaceIndex:
    """`places` places with descriptors like this one."""
    table = PlaceTable.from_places(
        [Place(i, 1, i, Pose(0.0, 0.0), 1.0, embedding.mean * (1.0 + 0.01 * i)) for i in range(max(places, 1))],
        len(embedding.mean),
    )
    index = PlaceIndex(len(embedding.mean), len(table))
    index.upsert(table)
    return index


def _median_ms(seconds: list[float]) -> float:
    return 1000.0 * float(np.median(seconds[WARM_UP:])) if len(seconds) > WARM_UP else float('nan')
