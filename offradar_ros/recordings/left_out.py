"""What a recording's positions lack, in words."""

from __future__ import annotations

from offradar_ros.geometry import LeftOut
from offradar_ros.positions.rules import CAUSES

_LONGEST = 200


def left_out_text(name: str, left_out: LeftOut, noun: str = 'position') -> str:
    """One line: how many positions, or rows, of the source `name` are left out, why, and more about the first."""
    count = f'{left_out.count} {noun}' if left_out.count == 1 else f'{left_out.count} {noun}s'
    first = left_out.first if len(left_out.first) <= _LONGEST else f'{left_out.first[:_LONGEST]} …'
    return f'{name}: {count} left out: {CAUSES.get(left_out.cause, left_out.cause)}' + (f' ({first})' if first else '')
