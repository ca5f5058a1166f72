"""The digest of an ONNX file: its last bytes are the SHA-256 of all bytes before them.

A protocol buffer grows by appending fields to it. So the digest is a metadata entry that is appended: no byte of what
the file holds changes, and every byte of it is covered.
"""

from __future__ import annotations

import hashlib

from offradar_ros.encoders.onnx_file import metadata_entry

KEY = 'offradar.digest'
_DIGITS = 64
_BEFORE_DIGITS = metadata_entry(KEY, '0' * _DIGITS)[:-_DIGITS]


def with_digest(content: bytes) -> bytes:
    """The content of an ONNX file, and its digest at the end."""
    covered = content + _BEFORE_DIGITS
    return covered + hashlib.sha256(covered).hexdigest().encode()


def has_digest(content: bytes) -> bool:
    """Whether the content ends with a digest, be it right or wrong."""
    return content[-_DIGITS - len(_BEFORE_DIGITS) : -_DIGITS] == _BEFORE_DIGITS


def digest_is_right(content: bytes) -> bool:
    """Whether the content ends with the digest of all before it."""
    found = hashlib.sha256(memoryview(content)[:-_DIGITS]).hexdigest()
    return has_digest(content) and content[-_DIGITS:] == found.encode()
