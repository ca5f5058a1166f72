"""Records in JSON files with the name and number of their format."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Generic, TypeVar

from offradar_ros.bounded_input import parse_json, read_bounded
from offradar_ros.encoders.model_files import first_line, write_atomically
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.records import structure, to_json, unstructure

RecordT = TypeVar('RecordT')
_LARGEST = 256 * 1024**2


@dataclasses.dataclass(frozen=True)
class StoredFormat(Generic[RecordT]):
    """A file format.

    Attributes:
        record: the dataclass that a file holds.
        kind: name of the format.
        number: of the format; it rises with every change after which older files cannot be read.
        description: of the file, for error messages.
        remedy: what to do with a file of another number, for error messages.
    """

    record: type[RecordT]
    kind: str
    number: int
    description: str
    remedy: str

    @property
    def tag(self) -> str:
        """Name and number, as the file has them."""
        return f'{self.kind}-{self.number}'

    def write(self, path: str | Path, record: RecordT) -> None:
        """Write the file atomically; ModelError if it cannot be written."""
        write_atomically(path, to_json({'format': self.tag, **unstructure(record)}).encode())

    def read(self, path: str | Path) -> RecordT:
        """The record in a file of `write`, with NaN for null; DataError for another file or format."""
        try:
            tree = parse_json(read_bounded(path, _LARGEST), _LARGEST)
        except (OSError, ValueError) as error:
            raise DataError(f'{path}: expected {self.description} ({first_line(error)})') from None
        found = str(tree.pop('format', '')) if isinstance(tree, dict) else ''
        if not found.startswith(f'{self.kind}-'):
            raise DataError(f'{path}: expected {self.description}')
        if found != self.tag:
            raise DataError(f'{path}: expected format {self.tag}, got {found}: {self.remedy}')
        try:
            return structure(self.record, tree)
        except ConfigError as error:
            raise DataError(f'{path}: damaged ({error}): {self.remedy}') from None
