"""A method that was measured: its model, its thresholds and what it costs."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.thresholds import Thresholds
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class Cost:
    """What an encoder costs on the machine that measured it; never compared with figures of another machine.

    Attributes:
        encode_ms: median time of encoding one scan, decoding left out; NaN where too few scans were encoded.
        search_ms: median time of finding the ten nearest places in a map of the mean size; NaN likewise.
        bytes_per_place: of its descriptor.
        peak_memory_mb: of the process until then.
    """

    encode_ms: Measure
    search_ms: Measure
    bytes_per_place: Measure
    peak_memory_mb: Measure


@dataclasses.dataclass(frozen=True)
class MethodRecord:
    """One method.

    Attributes:
        encoder: its kind.
        fingerprint: of the model; of that of one of the maps for a method that is fitted to each.
        dimension: d of the embedding.
        weights: name of the file, if any.
        settings: metadata of the model.
        fitted_to_each_map: whether each map has an encoder of its own.
        thresholds: on U.
        cost: of encoding and searching.
    """

    encoder: str
    fingerprint: str
    dimension: int
    weights: str
    settings: dict[str, str]
    fitted_to_each_map: bool
    thresholds: Thresholds
    cost: Cost
