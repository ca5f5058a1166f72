"""Metadata of the weights of a learned encoder, in a weights file and in the ONNX file exported from it.

Text entries: ``offradar.settings`` (JSON of `NetworkConfig`), ``offradar.fingerprint``, ``offradar.created_by``
(package and version), ``offradar.description`` and ``offradar.stored`` (precision of the weight matrices on disk; all
have single precision when loaded). Needs no safetensors: a vehicle reads ONNX files only.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from offradar_ros import __version__
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.errors import ConfigError, ModelError

STORED = ('float32', 'float16', 'int8')


@dataclasses.dataclass(frozen=True)
class WeightsHeader:
    """Metadata of a weights file, or of the ONNX file exported from it."""

    config: NetworkConfig
    fingerprint: str
    created_by: str = f'offradar_ros {__version__}'
    description: str = ''
    stored: str = 'float32'

    def to_metadata(self) -> dict[str, str]:
        """Text entries for `from_metadata`."""
        return {
            'offradar.settings': self.config.to_json(),
            'offradar.fingerprint': self.fingerprint,
            'offradar.created_by': self.created_by,
            'offradar.description': self.description,
            'offradar.stored': self.stored,
        }

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str], path: str | Path) -> WeightsHeader:
        """Header from the entries of `path`; ModelError if they are missing or invalid."""
        fields = ('settings', 'fingerprint', 'created_by', 'description', 'stored')
        missing = [field for field in fields if f'offradar.{field}' not in metadata]
        if missing:
            raise ModelError(f'{path}: not offradar weights: its metadata has no offradar.{missing[0]}')
        settings, digest, created_by, description, stored = (metadata[f'offradar.{field}'] for field in fields)
        if len(digest) != 64 or set(digest) - set('0123456789abcdef'):
            raise ModelError(f'{path}: offradar.fingerprint: expected 64 hexadecimal digits, got {digest[:80]!r}')
        if stored not in STORED:
            raise ModelError(f'{path}: offradar.stored: expected one of {", ".join(STORED)}, got {stored[:80]!r}')
        try:
            return cls(NetworkConfig.from_json(settings), digest, created_by, description, stored)
        except ConfigError as error:
            raise ModelError(f'{path}: {error}') from error
