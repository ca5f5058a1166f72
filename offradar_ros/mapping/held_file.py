"""The map file that a writer has opened: it is locked itself, and a look shows whether its path still leads to it."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import FileState, file_state, status_of

_HELD: set[tuple[int, int]] = set()
"""Device and inode of each file that this process holds.

To open and close such a file again would release the locks that SQLite has on it.
"""


class HeldFile:
    """Holds the file at `path` until it is released, so that no other writer can, whatever becomes of `<map>.lock`.

    MapError if another writer holds it, or there is none. Open it before SQLite does, and release it after.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        status = status_of(path)
        if status is None or not stat.S_ISREG(status.st_mode):
            raise MapError(f'{path}: not a file: expected the path of a map file')
        self._inode = (status.st_dev, status.st_ino)
        if self._inode in _HELD:
            raise _in_use(path)
        self._file = _locked(path)
        _HELD.add(self._inode)
        self._state: FileState | None = None

    def is_in_place(self) -> bool:
        """Whether the path still leads to this file."""
        status = status_of(self._path)
        return status is not None and (status.st_dev, status.st_ino) == self._inode

    def is_missing(self) -> bool:
        """Whether there is nothing at the path."""
        return not os.path.lexists(self._path)

    def note_state(self) -> None:
        """Remember size and time of change: whatever differs later was written by somebody else."""
        self._state = file_state(self._path)

    def is_changed(self) -> bool:
        """Whether somebody has written the file or its log since `note_state`, as a copy over it does."""
        return self._state is not None and file_state(self._path) != self._state

    def release(self) -> None:
        """Let go of the file."""
        _HELD.discard(self._inode)
        os.close(self._file)


def _locked(path: Path) -> int:
    try:
        try:
            file = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        except PermissionError:
            file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError as error:
        raise MapError(f'{path}: the map cannot be opened ({error.strerror})') from error
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(file)
        raise _in_use(path) from None
    except OSError:
        # A file system without such locks: the lock file and the seal, which each write compares, remain.
        pass
    return file


def _in_use(path: Path) -> MapError:
    return MapError(f'{path}: the map is in use by another process that writes it')
