"""Compare newly measured ratios with the committed ones: exit status 1 if one has grown or is missing.

Times differ from machine to machine, ratios within one run hardly do: every figure whose name starts with `ratio` is
compared; lower is better.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

COMMITTED = Path(__file__).parent / 'results'
PREFIX = 'ratio'
LARGEST = 3.0
"""Committed ratios above this are not compared: they relate a fixed cost to almost none, and vary."""


def ratios(record: Any, path: str = '', inside: bool = False) -> Iterator[tuple[str, float]]:
    """Every ratio in a results file under its dotted name, also those nested in a ratio."""
    if isinstance(record, dict):
        for key, value in record.items():
            yield from ratios(value, f'{path}.{key}' if path else key, inside or key.startswith(PREFIX))
    elif inside and isinstance(record, (int, float)):
        yield path, float(record)


def compare(fresh: dict[str, Any], committed: dict[str, Any], slack: float) -> tuple[list[str], int]:
    """A line for each committed ratio, and the number that are missing or have grown by more than `slack`."""
    now, lines, wrong = dict(ratios(fresh)), [], 0
    for name, before in ratios(committed):
        if before > LARGEST:
            continue
        # The comparison is false for NaN.
        fine = name in now and now[name] <= before * (1.0 + slack)
        wrong += not fine
        found = f'{now[name]:.3g}' if name in now else 'missing'
        lines.append(f'{"ok" if fine else "WRONG":5} {name}: {found}, committed {before:.3g}')
    return lines, wrong


def main() -> int:
    """Compare every file of the same name in both folders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('fresh', type=Path, help='folder of newly measured results')
    parser.add_argument('--committed', type=Path, default=COMMITTED)
    parser.add_argument('--slack', type=float, default=0.35, help='growth that is accepted (default 0.35)')
    arguments = parser.parse_args()
    compared = total = 0
    for path in sorted(arguments.fresh.glob('*.json')):
        committed = arguments.committed / path.name
        if not committed.is_file():
            print(f'{path.name}: nothing committed to compare with')
            continue
        fresh, before = (json.loads(file.read_text(encoding='utf-8')) for file in (path, committed))
        if (fresh.get('machine'), fresh.get('versions')) != (before.get('machine'), before.get('versions')):
            print(f'{path.name}: the committed results are of another machine or other versions: ratios may differ')
        lines, wrong = compare(fresh, before, arguments.slack)
        print(path.name, *lines, sep='\n  ')
        compared, total = compared + len(lines), total + wrong
    if not compared:
        print(f'error: {arguments.fresh}: expected results that are also in {arguments.committed}', file=sys.stderr)
        return 2
    print(f'{compared} ratios compared, {total} missing, or grown by more than {arguments.slack:.0%}')
    return 1 if total else 0


if __name__ == '__main__':
    sys.exit(main())
