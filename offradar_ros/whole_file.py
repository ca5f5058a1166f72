"""Writes a file whole or not at all, so that no reader and no power cut ever meets half of one."""

from __future__ import annotations

import codecs
import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

_START = 4096
_KINDS = {
    b'SQLite format 3\0': 'a SQLite database, such as a map',
    b'\x89MCAP': 'an MCAP recording',
    b'#ROSBAG': 'a ROS 1 recording',
    b'\x89PNG': 'a PNG image',
}
_TEXT, _BINARY = 'text', 'binary data'


@contextlib.contextmanager
def whole_file(path: str | Path) -> Iterator[BinaryIO]:
    """Yields a file to write to. It gets the name `path` at the end of the block, when it is on the disk.

    If the block raises, or the file cannot be written, what was at `path` is left as it was. A symbolic link at `path`
    is replaced, not followed; a file keeps its permissions. OSError for a folder that is missing or not writable, a
    full disk, a folder, device or FIFO at `path`, and a file there of another kind than the one that is written: a map
    or a recording is not replaced by a table because somebody mistook its name.
    """
    target = Path(path)
    with _draft(target) as (draft, file):
        yield file
        file.flush()
        os.fsync(file.fileno())
        file.seek(0)
        _require_same_kind(target, file.read(_START))
        draft.replace(target)
    sync_folder(target.parent)


@contextlib.contextmanager
def _draft(target: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """Yields a new file beside `target`, with its permissions; it is removed if it still has that name at the end."""
    mode = _mode(target)
    # A name that nobody can guess: a link or a file that was put there before would be written to. It does not contain
    # the target's name, to which nothing can be added where that is as long as the file system allows.
    draft = target.with_name(f'.offradar-{secrets.token_hex(8)}.partial')
    # O_CREAT takes the umask into account.
    descriptor = os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        with os.fdopen(descriptor, 'w+b') as file:
            if mode is not None:
                os.fchmod(descriptor, mode)
            yield draft, file
    finally:
        draft.unlink(missing_ok=True)


def require_replaceable(path: str | Path, start: bytes | None) -> None:
    """OSError where `whole_file` could not write a file that begins with `start`; None for a file of any kind.

    What is at `path` is left as it is.
    """
    target = Path(path)
    with _draft(target):
        if start is not None:
            _require_same_kind(target, start)


def write_whole_file(path: str | Path, content: bytes) -> None:
    """Write `content` to `path`, as `whole_file`."""
    with whole_file(path) as file:
        file.write(content)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network and overlay file systems cannot do this for a folder; the file itself is on the disk.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def _require_same_kind(target: Path, start: bytes) -> None:
    """OSError if what is at `target` is of another kind than a file that begins with `start`."""
    try:
        with target.open('rb') as file:
            there = file.read(_START)
    except FileNotFoundError:
        return
    except PermissionError:
        # Who may write to the folder may replace what they cannot read; nobody can tell what it is.
        return
    if there and _kind(there) != _kind(start):
        what = f'Holds {_kind(there)}, and not what would be written: give another name'
        raise OSError(errno.EEXIST, what, str(target))


def _kind(start: bytes) -> str:
    for signature, kind in _KINDS.items():
        if start.startswith(signature):
            return kind
    # What is cut off at the end may be half a character.
    text = codecs.getincrementaldecoder('utf-8')()
    try:
        return _BINARY if '\0' in text.decode(start) else _TEXT
    except UnicodeDecodeError:
        return _BINARY


def _mode(target: Path) -> int | None:
    """Permissions of the file at `target`, None where there is none; OSError where a file must not be replaced."""
    try:
        # Followed: ``/dev/stdout`` is a link, and a name that programs rely on.
        status = target.stat()
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, 'Not a regular file', str(target))
    return None if target.is_symlink() else stat.S_IMODE(status.st_mode)
