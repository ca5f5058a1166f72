"""The sections of a report, independent of the format."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class TableSection:
    """A table: `name` is that of its CSV file, `head` and `rows` are text.

    `best` and `second` are the (row, column) of cells with the highest and second highest value of their column.
    """

    name: str
    title: str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    second: frozenset[tuple[int, int]] = frozenset()


@dataclasses.dataclass(frozen=True)
class FigureSection:
    """A picture: `name` is that of its file, `png` its content, `alternative` its alternative text."""

    name: str
    title: str
    caption: str
    alternative: str
    png: bytes


@dataclasses.dataclass(frozen=True)
class Report:
    """Title, remarks for the start, tables and figures in their order, command line and software versions."""

    title: str
    remarks: tuple[str, ...]
    tables: tuple[TableSection, ...]
    figures: tuple[FigureSection, ...]
    command: str
    versions: str
