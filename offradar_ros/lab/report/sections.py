"""What a report is made of, whatever it is written as."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class TableSection:
    """A table: `name` is that of its CSV file, `head` and `rows` are text.

    `best` and `second` are the rows and columns of cells that stand out; Recall@1 and the like is higher there than
    elsewhere in the column.
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
    """A picture: `name` is that of its file, `png` its content, `alternative` what it shows in words."""

    name: str
    title: str
    caption: str
    alternative: str
    png: bytes


@dataclasses.dataclass(frozen=True)
class Report:
    """Title, what is to be known before anything else, the tables and figures in their order, and how it was made."""

    title: str
    remarks: tuple[str, ...]
    tables: tuple[TableSection, ...]
    figures: tuple[FigureSection, ...]
    command: str
    versions: str
