"""The tables of the page."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from faults.page import END, START, tables, write_tables
from faults.result import Result


def test_the_tables_are_replaced_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / 'page.md'
    page.write_text(f'before\n{START}old\n{END}after\n')
    results = [
        Result('flips', 'damaged map', 500, refused=400, same=100, seconds=2.0),
        Result('soak', 'a minute', 1000, same=990, losses=10, seconds=60.0, figures={'sessions': 5}),
    ]
    record = {
        'seeds': {'faults': 3},
        'machine': {'cores': 2, 'processor': 'a processor'},
        'results': [dataclasses.asdict(result) for result in results],
    }
    write_tables(page, record)
    text = page.read_text()
    assert text == f'before\n{START}{tables(record)}{END}after\n'
    assert '| flips | damaged map | 500 | 400 | 100 | 0 | 0 | 0 |' in text
    assert '| | **all** | 1,500 | 400 | 1,090 | 0 | 0 | 10 |' in text
    assert '* soak: sessions 5' in text
    assert 'Seed 3, 2 cores of a processor, 62 s in all.' in text
