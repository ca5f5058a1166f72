"""One writer a map file."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from offradar_ros.errors import MapError


class WriterLock:
    """Holds `<map>.lock` until released or until the process ends, however it ends.

    A file of its own: closing any handle on the map itself would drop the locks that SQLite holds on it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(path.name + '.lock')
        self._file = self._acquire(path)

    def _acquire(self, path: Path) -> int:
        while True:
            try:
                file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            except OSError as error:
                raise MapError(f'{path}: the map cannot be written there ({error.strerror})') from error
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # The holder before may have removed the file between the two calls: only the one in the folder counts.
                if os.path.samestat(os.fstat(file), os.stat(self._path)):  # noqa: PTH116
                    return file
            except FileNotFoundError:
                pass
            except OSError as error:
                os.close(file)
                busy = isinstance(error, BlockingIOError)
                why = 'is in use by another process that writes it' if busy else f'cannot be locked ({error.strerror})'
                raise MapError(f'{path}: the map {why}') from error
            os.close(file)

    def release(self) -> None:
        """Let another writer in."""
        self._path.unlink(missing_ok=True)
        os.close(self._file)
