"""Whether newly measured ratios are still those that are committed: exit status 1 where one has grown.

Times differ from machine to machine, ratios within one run hardly: every figure whose name starts with `ratio` is
compared, lower being better.
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


def ratios(record: Any, path: str = '') -> Iterator[tuple[str, float]]:
    """Every ratio in a results file under its dotted name."""
    if not isinstance(record, dict):
        return
    for key, value in record.items():
        name = f'{path}.{key}' if path else key
        if key.startswith(PREFIX) and isinstance(value, (int, float)):
            yield name, float(value)
        else:
            yield from ratios(value, name)


def compare(fresh: dict[str, Any], committed: dict[str, Any], slack: float) -> tuple[list[str], int]:
    """A line for each ratio that both have, and how many of them have grown by more than `slack`."""
    before, lines, grown = dict(ratios(committed)), [], 0
    for name, now in ratios(fresh):
        if name in before:
            worse = now > before[name] * (1.0 + slack)
            grown += worse
            lines.append(f'{"GROWN" if worse else "ok":5} {name}: {now:.3g}, committed {before[name]:.3g}')
    return lines, grown


def main() -> int:
    """Compare every file of the same name in both folders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('fresh', type=Path, help='folder of newly measured results')
    parser.add_argument('--committed', type=Path, default=COMMITTED)
    parser.add_argument('--slack', type=float, default=0.35, help='growth that is no news (default 0.35)')
    arguments = parser.parse_args()
    compared = total = 0
    for path in sorted(arguments.fresh.glob('*.json')):
        committed = arguments.committed / path.name
        if not committed.is_file():
            print(f'{path.name}: nothing committed to compare with')
            continue
        fresh, before = (json.loads(file.read_text(encoding='utf-8')) for file in (path, committed))
        lines, grown = compare(fresh, before, arguments.slack)
        print(path.name, *lines, sep='\n  ')
        compared, total = compared + len(lines), total + grown
    if not compared:
        print(f'error: {arguments.fresh}: expected results that are also in {arguments.committed}', file=sys.stderr)
        return 2
    print(f'{compared} ratios compared, {total} grown by more than {arguments.slack:.0%}')
    return 1 if total else 0


if __name__ == '__main__':
    sys.exit(main())
