"""SHA-256 identity of a model: embeddings with equal fingerprints, and only those, can be compared."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Setting = bool | int | float | str


def canonical_json(settings: Mapping[str, Setting]) -> str:
    """JSON text of settings that does not depend on their order; ValueError for NaN or infinity."""
    return json.dumps(dict(settings), sort_keys=True, separators=(',', ':'), allow_nan=False)


def fingerprint(name: str, settings: Mapping[str, Setting], tensors: Mapping[str, NDArray[Any]] | None = None) -> str:
    """SHA-256 (64 hex digits) of an encoder's name, of every setting that changes its output and of its weights.

    Tensors are hashed in order of their names, each as name, dtype, shape and little-endian bytes in C order. The
    length of each part is hashed before it, so that no two models have the same byte stream.
    """
    digest = hashlib.sha256()

    def add(part: bytes) -> None:
        digest.update(len(part).to_bytes(8, 'little'))
        digest.update(part)

    add(name.encode())
    add(canonical_json(settings).encode())
    for key, tensor in sorted((tensors or {}).items()):
        little = np.ascontiguousarray(tensor, tensor.dtype.newbyteorder('<'))
        add(f'{key} {little.dtype.name} {list(tensor.shape)}'.encode())
        add(little.tobytes())
    return digest.hexdigest()
