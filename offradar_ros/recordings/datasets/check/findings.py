"""Results of a check."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

Level = Literal['ok', 'note', 'problem']


@dataclasses.dataclass(frozen=True)
class Finding:
    """One line for a person: `ok` is as it should be, `note` is information, `problem` has to be corrected."""

    level: Level
    text: str


@dataclasses.dataclass(frozen=True)
class Findings:
    """Everything found in the folder `path`, recognised as `layout`."""

    path: Path
    layout: str
    findings: tuple[Finding, ...]

    @property
    def problems(self) -> tuple[Finding, ...]:
        """The findings that have to be corrected."""
        return tuple(finding for finding in self.findings if finding.level == 'problem')


def ok(text: str) -> Finding:
    """A finding that is as it should be."""
    return Finding('ok', text)


def note(text: str) -> Finding:
    """A finding that is information."""
    return Finding('note', text)


def problem(text: str) -> Finding:
    """A finding that has to be corrected."""
    return Finding('problem', text)


def counted(count: int, noun: str) -> str:
    """A number and its noun, in the plural unless the number is 1."""
    return f'{count} {noun}' if count == 1 else f'{count} {noun}s'


def first_few(items: list[str], most: int = 3) -> str:
    """The first few of many, and how many more there are."""
    shown = ', '.join(items[:most])
    return shown if len(items) <= most else f'{shown} and {len(items) - most} more'
