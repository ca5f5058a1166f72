"""The results of the campaigns as tables of docs/reliability.md."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from faults.result import Result
from offradar_ros.whole_file import write_whole_file

START, END = '<!-- faults: the table of `make faults` -->\n', '<!-- end of faults -->\n'
HEAD = (
    '| campaign | what | tries | refused | as it should be | different | crashed | lost |\n'
    '|---|---|--:|--:|--:|--:|--:|--:|\n'
)


def write_tables(page: Path, record: Mapping[str, Any]) -> None:
    """Replace the tables of the page by those of a record that `fault_campaigns.py` has written."""
    text = page.read_text(encoding='utf-8')
    before, rest = text.split(START, 1)
    after = rest.split(END, 1)[1]
    write_whole_file(page, f'{before}{START}{tables(record)}{END}{after}'.encode())


def tables(record: Mapping[str, Any]) -> str:
    """The tables of a record, with what made it."""
    results = [Result(**(result | {'examples': tuple(result['examples'])})) for result in record['results']]
    machine = record['machine']
    made = (
        f'Seed {record["seeds"]["faults"]}, {machine["cores"]} cores of {machine["processor"]}, '
        f'{sum(result.seconds for result in results):.0f} s in all.\n'
    )
    return f'{made}\n{table(results)}\n{figures(results)}'


def table(results: Sequence[Result]) -> str:
    """A row for each result."""
    rows = [
        f'| {r.campaign} | {r.kind} | {r.tries:,} | {r.refused:,} | {r.same:,} | {r.differences} | {r.crashes} | '
        f'{r.losses} |\n'
        for r in results
    ]
    total = (
        f'| | **all** | {sum(r.tries for r in results):,} | {sum(r.refused for r in results):,} | '
        f'{sum(r.same for r in results):,} | {sum(r.differences for r in results)} | '
        f'{sum(r.crashes for r in results)} | {sum(r.losses for r in results)} |\n'
    )
    return HEAD + ''.join(rows) + total


def figures(results: Sequence[Result]) -> str:
    """What the campaigns measured besides."""
    return ''.join(
        f'* {r.campaign}: {", ".join(f"{name} {value:,}" for name, value in r.figures.items())}\n'
        for r in results
        if r.figures
    )


def read_record(path: Path) -> dict[str, Any]:
    """A record that `fault_campaigns.py` has written."""
    record: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    return record
