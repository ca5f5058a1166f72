"""A comment in a YAML file with the digest of its values, so that a digit that changed by itself is noticed.

Files that people are meant to edit have none. Comments and the layout may change: the digest is of the values.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Any


class AlteredError(ValueError):
    """The values are not those of their digest."""


_SAYS = 'digest of the values below, delete this line when you change one'
_LINE = re.compile(rf'^# {_SAYS}: ([0-9a-f]{{64}})\s*$', re.MULTILINE)


def digest_line(tree: Any) -> str:
    """The comment for a file that holds `tree`, with its line feed."""
    return f'# {_SAYS}: {_digest(tree)}\n'


def check_digest(text: str, tree: Any) -> None:
    """AlteredError if a text has such a comment, and `tree`, which it was parsed to, is not what was written."""
    found = _LINE.search(text)
    if found and found[1] != _digest(tree):
        raise AlteredError(
            'its values are not those of its digest: it is damaged, or if you changed it, delete its line "# digest …"'
        )


def _digest(tree: Any) -> str:
    return hashlib.sha256(json.dumps(_plain(tree), sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    return value if isinstance(value, (bool, int, float, str)) or value is None else str(value)
