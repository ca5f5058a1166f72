"""A digest of records: what was read from a damaged file is compared by it with what was read from the sound one."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np


def content_digest(*values: Any) -> str:
    """SHA-256 over values of dataclasses, arrays, mappings, sequences and plain types, to the last bit."""
    digest = hashlib.sha256()
    for value in values:
        _add(digest, value)
    return digest.hexdigest()


def _add(digest: Any, value: Any) -> None:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        digest.update(type(value).__name__.encode())
        for field in dataclasses.fields(value):
            _add(digest, getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        digest.update(f'{value.dtype}{value.shape}'.encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        digest.update(f'mapping of {len(value)}'.encode())
        for key in sorted(value, key=repr):
            _add(digest, key)
            _add(digest, value[key])
    elif isinstance(value, (list, tuple)):
        digest.update(f'sequence of {len(value)}'.encode())
        for item in value:
            _add(digest, item)
    elif isinstance(value, (type(None), bool, int, float, str, bytes, enum.Enum)):
        # repr distinguishes every float, NaN included.
        digest.update(f'{type(value).__name__} {value!r}'.encode())
    else:
        raise TypeError(f'no digest of {type(value).__name__}')
