"""The interface of encoders: a scan in, an embedding with a variance out."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from offradar_ros.errors import ModelError
from offradar_ros.types import Embedding, PolarScan

MAX_DIMENSION = 65_536
"""Largest d. The largest of ours, RadVLAD with 64 centres, is half of it."""

MAX_NAME_CHARACTERS = 200
MAX_METADATA_ENTRIES = 64
MAX_METADATA_CHARACTERS = 65_536
"""Most characters of all keys and values together."""

_FINGERPRINT = re.compile(r'[0-9a-f]{64}')


@dataclasses.dataclass(frozen=True)
class ModelInfo:
    """Identity of a model: embeddings are compared only if their `fingerprint` is the same.

    Also the check of a model that a message or a file tells of, before memory or a file is touched: ModelError for one
    that is outside the bounds above.

    Attributes:
        name: the encoder's name in the registry.
        fingerprint: SHA-256 (64 lower-case hex digits) of the weights and of every setting that changes the output.
        dimension: d, the length of mean and variance.
        metadata: settings and provenance, for people.
    """

    name: str
    fingerprint: str
    dimension: int
    metadata: Mapping[str, str]

    def __post_init__(self) -> None:
        problem = self._problem()
        if problem:
            raise ModelError(f'not a model: {problem}')

    def _problem(self) -> str | None:
        if not _is_text(self.name, MAX_NAME_CHARACTERS) or not self.name.isprintable() or not self.name:
            return f'expected a printable name of 1 to {MAX_NAME_CHARACTERS} characters'
        if not isinstance(self.fingerprint, str) or not _FINGERPRINT.fullmatch(self.fingerprint):
            return f'expected a fingerprint of 64 lower-case hex digits, got {self.fingerprint!r:.80}'
        # A bool is an int too.
        if type(self.dimension) is not int or not 1 <= self.dimension <= MAX_DIMENSION:
            return f'expected a dimension of 1 to {MAX_DIMENSION}, got {self.dimension!r:.80}'
        if len(self.metadata) > MAX_METADATA_ENTRIES:
            return f'{len(self.metadata)} entries of metadata: expected at most {MAX_METADATA_ENTRIES}'
        left = MAX_METADATA_CHARACTERS
        for item in (text for entry in self.metadata.items() for text in entry):
            if not _is_text(item, left):
                return f'expected metadata of valid text, of at most {MAX_METADATA_CHARACTERS} characters in all'
            left -= len(item)
        return None

    def is_same_model(self, other: ModelInfo) -> bool:
        """Whether both are of one model; name and metadata are for people only."""
        return (self.fingerprint, self.dimension) == (other.fingerprint, other.dimension)


def _is_text(value: object, longest: int) -> bool:
    """Whether a value is text that UTF-8 can hold: JSON may hold half a surrogate pair, which it cannot."""
    if not isinstance(value, str) or len(value) > longest:
        return False
    return value.isascii() or not any('\ud800' <= character <= '\udfff' for character in value)


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
