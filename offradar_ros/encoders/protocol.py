"""The interface of encoders: a scan in, an embedding with a variance out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from offradar_ros.types import Embedding, PolarScan


@dataclasses.dataclass(frozen=True)
class ModelInfo:
    """Identity of a model: embeddings are compared only if their `fingerprint` is the same.

    Attributes:
        name: the encoder's name in the registry.
        fingerprint: SHA-256 (64 hex digits) of the weights and of every setting that changes the output.
        dimension: d, the length of mean and variance.
        metadata: settings and provenance, for people.
    """

    name: str
    fingerprint: str
    dimension: int
    metadata: Mapping[str, str]


@runtime_checkable
class Encoder(Protocol):
    """Encodes one scan at a time, deterministically: the same scan gives the same embedding.

    Attributes:
        runs_on: ``cpu`` or ``cuda``. Not part of the model's identity.
    """

    runs_on: str

    @property
    def info(self) -> ModelInfo:
        """The model's identity."""

    def encode(self, scan: PolarScan) -> Embedding:
        """Embedding of one scan, with its stamp; RefusedInput for a scan without signal."""
