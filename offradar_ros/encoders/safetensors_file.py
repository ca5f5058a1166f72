"""safetensors files with a digest in their header: the SHA-256 of the whole file, with zeros in place of the digest."""

from __future__ import annotations

import hashlib
from pathlib import Path

from offradar_ros.bounded_input import parse_json
from offradar_ros.encoders.model_files import read_model_file
from offradar_ros.errors import ModelError

KEY = 'offradar.digest'
BLANK = {KEY: '0' * 64}
"""Metadata to save a file with for `with_digest`."""

_BEFORE_DIGITS = f'"{KEY}":"'.encode()
_LONGEST_HEADER = 100_000_000
"""Of the format."""


def with_digest(content: bytes) -> bytes:
    """The content of a file that was saved with the metadata `BLANK` and others, with its digest."""
    at = content.index(_BEFORE_DIGITS) + len(_BEFORE_DIGITS)
    return content[:at] + _digest(content, at) + content[at + 64 :]


def read_safetensors(path: str | Path) -> tuple[bytes, dict[str, str]]:
    """The content of a file, for ``load`` of safetensors, and its metadata.

    Read once: what was checked is what is loaded. ModelError for a file that is missing or not safetensors, and where
    its digest is wrong. Files of earlier versions have none.
    """
    content = read_model_file(path)
    header = content[8 : 8 + int.from_bytes(content[:8], 'little')]
    try:
        if int.from_bytes(content[:8], 'little') != len(header):
            raise ValueError('truncated, or no safetensors')
        tree = parse_json(header, _LONGEST_HEADER)
        metadata = tree.get('__metadata__', {}) if isinstance(tree, dict) else None
        if not isinstance(metadata, dict) or not all(isinstance(text, str) for text in metadata.values()):
            raise ValueError('no header of safetensors')
    except ValueError as error:
        raise ModelError(f'{path}: not a readable safetensors file ({error})') from error
    found = header.find(_BEFORE_DIGITS)
    at = 8 + found + len(_BEFORE_DIGITS)
    if found >= 0 and content[at : at + 64] != _digest(content, at):
        raise ModelError(f'{path}: damaged or altered: its content is not that of its digest: copy it again')
    return content, metadata


def _digest(content: bytes, at: int) -> bytes:
    digest = hashlib.sha256()
    for part in (memoryview(content)[:at], b'0' * 64, memoryview(content)[at + 64 :]):
        digest.update(part)
    return digest.hexdigest().encode()
