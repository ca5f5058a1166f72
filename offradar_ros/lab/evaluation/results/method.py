"""A method that was measured: its model, its thresholds and what it costs."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.thresholds import Thresholds
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class Cost:
    """The cost of an encoder on the machine that measured it; do not compare it between machines.

    Attributes:
        encode_ms: median time of encoding one scan, without reading it; NaN if too few scans were encoded.
        search_ms: median time of finding the ten nearest places in a map of mean size; NaN if too few were encoded.
        bytes_per_place: size of a descriptor.
        peak_memory_mb: of the evaluating process up to then.
    """

    encode_ms: Measure
    search_ms: Measure
    bytes_per_place: Measure
    peak_memory_mb: Measure


@dataclasses.dataclass(frozen=True)
class MethodRecord:
    """One method.

    Attributes:
        encoder: name of the encoder.
        fingerprint: of the model; of that of one map if the encoder is fitted to each.
        dimension: d of the embedding.
        weights: file name of the weights, empty for none.
        settings: metadata of the model.
        fitted_to_each_map: whether the encoder is fitted to each map.
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
