"""A lock that allows one writer for each map file."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

from offradar_ros.errors import MapError

LOCK_WAIT_S = 0.2
"""Longest wait for a process in `has_writer`, which holds the lock for an instant."""


class WriterLock:
    """Holds `<map>.lock` until it is released or the process ends, even by a kill.

    The lock is not on the map itself: closing any handle of that file would release the locks that SQLite holds.
    """

    def __init__(self, path: Path) -> None:
        self._path = _lock_file(path)
        self._file = self._acquire(path)

    def _acquire(self, path: Path) -> int:
        deadline_s = time.monotonic() + LOCK_WAIT_S
        while True:
            try:
                file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
            except OSError as error:
                if self._path.is_symlink():
                    # Whoever put it there chooses which file is made, or locked.
                    raise MapError(f'{self._path}: expected a lock, got a symbolic link: remove it') from error
                raise MapError(f'{path}: the map cannot be written there ({error.strerror})') from error
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # The previous holder may have removed this file between the two calls: is it still in the folder?
                if os.path.samestat(os.fstat(file), self._path.lstat()):
                    return file
            except FileNotFoundError:
                pass
            except OSError as error:
                busy = isinstance(error, BlockingIOError)
                if not busy or time.monotonic() > deadline_s:
                    os.close(file)
                    why = (
                        'is in use by another process that writes it'
                        if busy
                        else f'cannot be locked ({error.strerror})'
                    )
                    raise MapError(f'{path}: the map {why}') from error
                time.sleep(0.01)
            os.close(file)

    def keep(self, path: Path) -> None:
        """Take the lock again if its file was removed; MapError if another process has it now."""
        if not self._is_in_place():
            taken = self._acquire(path)
            os.close(self._file)
            self._file = taken

    def release(self) -> None:
        """Release the lock."""
        # A file that somebody else made there, after ours was removed, is theirs.
        if self._is_in_place():
            self._path.unlink(missing_ok=True)
        os.close(self._file)

    def _is_in_place(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._file), self._path.lstat())
        except OSError:
            return False


def has_writer(path: Path) -> bool:
    """Whether a process, this one included, may be writing the map at `path`; has no side effects."""
    try:
        file = os.open(_lock_file(path.resolve()), os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    # RuntimeError: a loop of links, in Python before 3.13.
    except (OSError, RuntimeError):
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def _lock_file(path: Path) -> Path:
    return path.with_name(path.name + '.lock')
