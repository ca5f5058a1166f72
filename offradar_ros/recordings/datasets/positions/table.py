"""Cells of a text table, with the line each came from, so that an error can name it."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns


class Row(NamedTuple):
    """The wanted cells of one line."""

    path: Path
    line: int
    names: Sequence[str]
    cells: Sequence[str]

    def number(self, at: int) -> float:
        """Cell `at` as a float, NaN and infinities included; DataError names file, line and column."""
        try:
            return float(self.cells[at])
        except ValueError:
            raise self.problem(f'expected a number for {self.names[at]}, got {self.cells[at]!r}') from None

    def finite(self, at: int) -> float:
        """Cell `at` as a finite float."""
        value = self.number(at)
        if not math.isfinite(value):
            raise self.problem(f'expected a finite number for {self.names[at]}, got {self.cells[at]!r}')
        return value

    def stamp_ns(self, at: int = 0) -> int:
        """Cell `at` as nanoseconds; the magnitude shows the unit."""
        try:
            return parse_stamp_ns(self.cells[at])
        except ValueError as error:
            raise self.problem(f'expected a stamp for {self.names[at]}: {error}') from None

    def problem(self, text: str) -> DataError:
        """An error about this line."""
        return DataError(f'{self.path}, line {self.line}: {text}')


def named_rows(path: Path, names: Sequence[str]) -> Iterator[Row]:
    """The columns `names` of a CSV file whose first line is a header; other columns are ignored."""
    lines = _lines(path, ',')
    _, header = next(lines, (0, []))
    header = [cell.strip() for cell in header]
    missing = [name for name in names if name not in header]
    if missing:
        what = f'no column {", ".join(missing)}' if header else 'empty file'
        raise DataError(f'{path}, line 1: {what}: expected a header with {", ".join(names)}')
    wanted = [header.index(name) for name in names]
    for line, cells in lines:
        if len(cells) != len(header):
            raise DataError(f'{path}, line {line}: expected {len(header)} columns as in the header, got {len(cells)}')
        yield Row(path, line, names, [cells[i] for i in wanted])


def bare_rows(path: Path, names: Sequence[str], separator: str = ',') -> Iterator[Row]:
    """All columns of a table without header, `names` in order; lines that start with # are comments."""
    for line, cells in _lines(path, separator):
        if cells[0].startswith('#'):
            continue
        if len(cells) != len(names):
            expected = ', '.join(names)
            raise DataError(f'{path}, line {line}: expected {len(names)} columns ({expected}), got {len(cells)}')
        yield Row(path, line, names, cells)


def _lines(path: Path, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Line number from 1 and stripped cells of every line that is not blank."""
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:
            reader = csv.reader(file, delimiter=separator, skipinitialspace=True)
            for cells in reader:
                stripped = [cell.strip() for cell in cells]
                while separator == ' ' and stripped and not stripped[-1]:
                    stripped.pop()
                if any(stripped):
                    yield reader.line_num, stripped
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f'{path}: not a text table ({error})') from None
