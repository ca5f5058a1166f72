"""Stamps as data sets write them, whole numbers or decimals of s, ms, µs or ns since the Unix epoch, to nanoseconds."""

from __future__ import annotations

import decimal
from pathlib import Path

_LARGEST_NS = 2**63 - 1
# From 1973 to 2286 the magnitude alone shows the unit: lower bound, factor to ns.
_UNITS = ((10**17, 1), (10**14, 10**3), (10**11, 10**6), (10**8, 10**9))


def parse_stamp_ns(text: str) -> int:
    """Nanoseconds of an epoch stamp whose unit its magnitude shows; exact. ValueError if it is no such number."""
    try:
        value = decimal.Decimal(text.strip())
    except decimal.InvalidOperation:
        raise ValueError(f'{text!r} is not a number') from None
    if value.is_finite():
        for bound, factor in _UNITS:
            if value >= bound:
                stamp_ns = round(value * factor) if value < 10**19 else _LARGEST_NS + 1
                if stamp_ns <= _LARGEST_NS:
                    return stamp_ns
                break
    raise ValueError(f'{text!r} is not a time since 1970 in s, ms, µs or ns')


def stamp_of_name(path: Path) -> int | None:
    """Nanoseconds of a file named by its stamp in µs or ns (at least 16 digits), else None."""
    stem = path.stem
    if not (stem.isascii() and stem.isdigit() and len(stem) >= 16):
        return None
    try:
        return parse_stamp_ns(stem)
    except ValueError:
        return None
