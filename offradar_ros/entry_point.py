"""The guard around every program: an error that input or machine causes is one line and exit status 1."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import stat
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from offradar_ros.errors import DataError, OffradarError

DEFECT = 'a defect in offradar_ros, and not in what it was given: please report it with the lines above'
REMEDIES = {
    errno.EACCES: 'run as a user who may, or change its permissions',
    errno.EPERM: 'run as a user who may, or change its permissions',
    errno.ENOSPC: 'free some space, or write elsewhere',
    errno.EDQUOT: 'free some space, or write elsewhere',
    errno.EROFS: 'write to another folder',
    errno.ELOOP: 'remove the symbolic link that leads to itself',
    errno.ENAMETOOLONG: 'use a shorter name',
    errno.EMFILE: 'raise the limit of open files (ulimit -n)',
    errno.ENFILE: 'raise the limit of open files (ulimit -n)',
    errno.EIO: 'the disk reports a fault',
}
"""What to do about an error of the operating system."""
INTERRUPTED = 130
_KINDS = {
    stat.S_IFIFO: 'a FIFO',
    stat.S_IFSOCK: 'a socket',
    stat.S_IFCHR: 'a device',
    stat.S_IFBLK: 'a device',
}


def explain(error: BaseException) -> str:
    """One line for an error that input or machine causes, with what to do; empty for a defect of the program."""
    if isinstance(error, OffradarError):
        return str(error)
    if isinstance(error, MemoryError):
        return 'out of memory: close other programs, or use a smaller input'
    if isinstance(error, ImportError) and error.name and error.name.partition('.')[0] != __package__:
        return f'the package {error.name.partition(".")[0]} cannot be used: {_first_line(error)}'
    if isinstance(error, OSError):
        return _explain_os_error(error)
    return ''


def _explain_os_error(error: OSError) -> str:
    if error.errno == errno.ENOENT and not _has_working_folder():
        return 'the working folder was removed: change to another'
    what = error.strerror or _first_line(error)
    where = [os.fsdecode(name) for name in (error.filename, error.filename2) if isinstance(name, (str, bytes))]
    remedy = REMEDIES.get(error.errno or 0, '')
    return ': '.join([*where, what, *([remedy] if remedy else [])])


def _has_working_folder() -> bool:
    try:
        os.getcwd()  # noqa: PTH109 - asks the operating system only
    except OSError:
        return False
    return True


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), '') or type(error).__name__


def special_file(path: str | os.PathLike[str]) -> str:
    """What a path is that is neither a file nor a folder, such as `a FIFO`; empty for those and for what is not there.

    A program that opens a FIFO waits until somebody writes to it.
    """
    try:
        return _KINDS.get(stat.S_IFMT(os.stat(path).st_mode), '')  # noqa: PTH116 - also for str
    except (OSError, ValueError):
        return ''


def require_ordinary_files(path: Path) -> None:
    """DataError for a FIFO, socket or device at a path, or anywhere in the folder that it is.

    Libraries that read recordings open whatever has the right name. Folders that may not be read are left to them.
    """
    for each in [path, *_below(path)]:
        if kind := special_file(each):
            raise DataError(f'{each}: is {kind}: expected a file or a folder')


def _below(folder: Path) -> Iterator[Path]:
    """What is below a folder and neither a file nor a folder by its entry there."""
    waiting = [folder]
    while waiting:
        with contextlib.suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(Path(entry.path))
                elif not entry.is_file():
                    yield Path(entry.path)


def run_guarded(program: Callable[[], int]) -> int:
    """Exit status of a program; whatever it raises becomes one line on stderr.

    1 for an error, and for a reader of stdout that has gone, silently; 130 for Ctrl-C. A defect shows its traceback
    before the line. SystemExit passes.
    """
    _open_closed_streams()
    _accept_any_text()
    try:
        try:
            return program()
        finally:
            _flush()
    except BrokenPipeError:
        return 1
    except KeyboardInterrupt:
        _say('interrupted')
        return INTERRUPTED
    except Exception as error:
        report(error)
        return 1


def report(error: Exception) -> None:
    """Print one line about an error on stderr, after its traceback if it is a defect."""
    text = explain(error)
    if not text:
        _say(''.join(traceback.format_exception(error)).rstrip())
    _say(f'error: {" ".join((text or DEFECT).split())}')


def _say(text: str) -> None:
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):
            print(text, file=sys.stderr, flush=True)


def _open_closed_streams() -> None:
    """Give a program that was started without stdin, stdout or stderr the null device in their place.

    Else the next file that is opened, such as a map, takes the number, and whatever a library prints is written to it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name, number in (('stdout', 1), ('stderr', 2)):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, 'w', closefd=False))


def _accept_any_text() -> None:
    """Print what an encoding does not have, or a file name that is not valid in it, as \\x…, and do not fail."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        # None: it was closed before the program started.
        if stream is not None and not stream.closed:
            stream.flush()
