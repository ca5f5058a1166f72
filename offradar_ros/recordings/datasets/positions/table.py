"""Cells of a text table, with the line each came from, so that an error can name it.

A line that is damaged is a row with a fault: who reads its cells gets the error, and may go on with the next.
"""

from __future__ import annotations

import csv
import decimal
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns
from offradar_ros.recordings.datasets.text_encoding import encoding_of_file

_LONGEST_LINE = 64 * 1024
_SEPARATORS = {',': 'commas', ';': 'semicolons', '\t': 'tabs', ' ': 'spaces'}
_MOST_SHOWN = 100


class Row(NamedTuple):
    """The wanted cells of one line; where it is damaged, `fault` says how, and there are none."""

    path: Path
    line: int
    names: Sequence[str]
    cells: Sequence[str]
    fault: str = ''
    decimal_comma: bool = False

    def text(self, at: int) -> str:
        """Cell `at` as it is written; DataError for a damaged line."""
        if self.fault:
            raise self.problem(self.fault)
        return self.cells[at].replace(',', '.') if self.decimal_comma else self.cells[at]

    def number(self, at: int) -> float:
        """Cell `at` as a float, NaN and infinities included; DataError names file, line and column."""
        text = self.text(at)
        try:
            return float(text)
        except ValueError:
            raise self.problem(f'expected a number for {self.names[at]}, got {_shown(text)}') from None

    def number_or_nan(self, at: int) -> float:
        """Cell `at` as a float; NaN for an empty cell, as many receivers write it without a fix."""
        return self.number(at) if self.text(at) else math.nan

    def finite(self, at: int) -> float:
        """Cell `at` as a finite float."""
        value = self.number(at)
        if not math.isfinite(value):
            raise self.problem(f'expected a finite number for {self.names[at]}, got {self.cells[at]!r}')
        return value

    def stamp_ns(self, at: int = 0) -> int:
        """Cell `at` as nanoseconds; the magnitude shows the unit."""
        try:
            return parse_stamp_ns(self.text(at))
        except ValueError as error:
            raise self.problem(f'expected a stamp for {self.names[at]}: {error}') from None

    def problem(self, text: str) -> DataError:
        """An error about this line."""
        return DataError(f'{self.path}, line {self.line}: {text}')


def has_missing_digits(text: str) -> bool:
    """Whether a number lacks digits before the decimal point, as 1.547E+15 does."""
    try:
        exponent = decimal.Decimal(text.strip()).as_tuple().exponent
    except decimal.InvalidOperation:
        return False
    return isinstance(exponent, int) and exponent > 0


def named_rows(path: Path, names: Sequence[str]) -> Iterator[Row]:
    """The columns `names` of a table whose first line is a header; other columns are ignored.

    Separated by commas, semicolons (then numbers may have decimal commas) or tabs; capitals in names do not matter.
    """
    lines = _lines(path)
    _, first, _ = next(lines, (0, '', True))
    separator, header = _header(first, names)
    wanted_names = [name.lower() for name in names]
    missing = [name for name, wanted in zip(names, wanted_names, strict=True) if wanted not in header]
    if missing:
        if first and (fault := _character_fault(first)):
            raise DataError(f'{path}, line 1: {fault}: expected a header with {", ".join(names)}')
        what = f'no column {", ".join(missing)}' if first else 'empty file'
        found = f', found {_shown(first)} separated by {_SEPARATORS[separator]}' if first else ''
        raise DataError(f'{path}, line 1: {what}: expected a header with {", ".join(names)}{found}')
    wanted = [header.index(name) for name in wanted_names]
    for line, cells, fault in _rows(lines, separator, len(header), f'{len(header)} columns as in the header'):
        if not fault and [cell.lower() for cell in cells] == header:
            yield Row(path, line, names, (), 'the header again: expected a row of numbers')
        else:
            chosen = () if fault else [cells[i] for i in wanted]
            yield Row(path, line, names, chosen, fault, decimal_comma=separator == ';')


def bare_rows(path: Path, names: Sequence[str], separator: str = ',') -> Iterator[Row]:
    """All columns of a table without header, `names` in order; lines that start with # are comments."""
    expected = f'{len(names)} columns ({", ".join(names)})'
    lines = ((number, text, ended) for number, text, ended in _lines(path) if not text.startswith('#'))
    for line, cells, fault in _rows(lines, separator, len(names), expected):
        yield Row(path, line, names, () if fault else cells, fault)


def _header(text: str, names: Sequence[str]) -> tuple[str, list[str]]:
    """The separator that gives most of the wanted columns, and the columns in small letters."""
    wanted = {name.lower() for name in names}
    found = {separator: [cell.lower() for cell in _cells(text, separator)] for separator in (',', ';', '\t')}
    separator = max(found, key=lambda each: (len(wanted & set(found[each])), len(found[each])))
    return separator, found[separator]


def _rows(
    lines: Iterator[tuple[int, str, bool]], separator: str, columns: int, expected: str
) -> Iterator[tuple[int, list[str], str]]:
    """Line number, cells and fault of each line; a cell that is empty after the last column is no column."""
    shortest = _LONGEST_LINE
    for line, text, ended in lines:
        fault = _character_fault(text)
        cells = [] if fault else _cells(text, separator)
        while len(cells) > columns and not cells[-1]:
            cells.pop()
        if not fault and len(cells) != columns:
            fault = f'expected {expected}, got {len(cells)}'
        if not fault and not ended and len(cells[-1]) < shortest < _LONGEST_LINE:
            fault = f'expected a whole line, got one that ends within {cells[-1]!r}: the file is cut off'
        if not fault:
            shortest = min(shortest, len(cells[-1]))
        yield line, cells, fault


def _character_fault(text: str) -> str:
    if len(text) >= _LONGEST_LINE:
        return f'expected a row, got a line of over {_LONGEST_LINE} characters'
    if '\0' in text:
        return 'expected text, got NUL bytes'
    if any('\ud800' <= character <= '\udfff' for character in text):
        return 'expected UTF-8 text'
    return ''


def _cells(text: str, separator: str) -> list[str]:
    """Stripped cells of one line; a quote that is not closed ends with it."""
    if separator == ' ':
        return text.split()
    if '"' in text:
        try:
            return [cell.strip() for cell in next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])]
        except csv.Error:
            pass
    return [cell.strip() for cell in text.split(separator)]


def _lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Number from 1, text and whether it is ended of every line that is not blank, or only separators."""
    if path.exists() and not path.is_file():
        raise DataError(f'{path}: cannot be read (not a regular file)')
    try:
        encoding = encoding_of_file(path)
        # A byte that is no text damages its line only; in UTF-16 there is nothing to escape it to.
        errors = 'replace' if encoding == 'utf-16' else 'surrogateescape'
        with path.open(encoding=encoding, errors=errors) as file:
            number = 0
            while text := file.readline(_LONGEST_LINE):
                number += 1
                whole = text
                while len(whole) == _LONGEST_LINE and not whole.endswith('\n'):
                    whole = file.readline(_LONGEST_LINE)
                if text.strip(' \t\r\n,;'):
                    yield number, text.strip(' \r\n'), whole.endswith('\n')
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None


def _shown(text: str) -> str:
    shown = ascii(text[:_MOST_SHOWN])
    return shown if len(text) <= _MOST_SHOWN else f'{shown} …'
