"""Version of the simulator: cached scans belong to one version of its source."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path


@functools.cache
def source_digest() -> str:
    """SHA-256 (64 hex digits) of the simulator's source, computed once per process."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for file in sorted(root.rglob('*.py')):
        digest.update(file.relative_to(root).as_posix().encode() + b'\0' + file.read_bytes() + b'\0')
    return digest.hexdigest()
