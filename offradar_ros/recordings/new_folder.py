"""A folder that appears under its name only when it is complete and on the disk: a bag or a data-set folder."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.errors import DataError
from offradar_ros.whole_file import sync_folder

_PARTIAL = re.compile(r'\.[0-9a-f]{16}\.partial')


@contextlib.contextmanager
def new_folder(out: Path, *, overwrite: bool, mark: str = 'metadata.yaml') -> Iterator[Path]:
    """Yields the folder to write, which is moved to `out` at the end, and removed if the block raises.

    It is named like `out`, because a recording's file is named after its folder, and lies in ``OUT.TOKEN.partial``,
    a name that nobody can guess. What runs that were cut off left there is removed; that of a run that still writes is
    not. DataError if `out` exists and may not be replaced (only a folder with a file named `mark` may: by default, a
    bag), if files of somebody else are in the way, or if it cannot be written. A link is replaced, its target is not.
    """
    _require_name(out)
    partial = out.with_name(f'{out.name}.{secrets.token_hex(8)}.partial')
    unlocked = partial.with_suffix('.new')
    aside = out.with_name(out.name + '.replaced')
    try:
        _require_free(out, overwrite, mark)
        if os.path.lexists(aside):
            raise DataError(f'{aside}: in the way, left by a run that was cut off: move it to {out} or remove it')
        _remove_left_by_others(out)
        unlocked.mkdir(parents=True)
        with _locked(unlocked):
            # Only now under the name that others look for: they would take it for one that was left.
            unlocked.rename(partial)
            try:
                yield partial / out.name
                _sync(partial / out.name)
                # Another run may have put one there in the meantime.
                _require_free(out, overwrite, mark)
                _move(partial / out.name, out, aside)
            finally:
                shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        raise DataError(f'{out}: cannot be written ({error.strerror or error})') from error


def _require_name(out: Path) -> None:
    if out.name in ('', '..') or '\0' in str(out) or str(out).encode(errors='ignore').decode() != str(out):
        raise DataError(f'{str(out)!r}: expected the path of a new folder')


def _require_free(out: Path, overwrite: bool, mark: str) -> None:
    if not os.path.lexists(out):
        return
    if not overwrite:
        raise DataError(f'{out}: exists already: choose another folder or pass --overwrite')
    if not (out / mark).exists():
        kind = 'a bag' if mark == 'metadata.yaml' else f'a folder with {mark}'
        raise DataError(f'{out}: exists and is not {kind}: not overwritten, choose another folder')


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Yields whether the lock of a folder could be had, at once; OSError if `folder` is a link or no folder."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        # The kernel lets go of it when the process ends, however it ends.
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        is_ours = True
    except OSError:  # held, or a file system without locks
        is_ours = False
    try:
        yield is_ours
    finally:
        os.close(descriptor)


def _remove_left_by_others(out: Path) -> None:
    """Remove what runs left that were cut off; anything else with such a name stays."""
    if not out.parent.is_dir():
        return
    for found in out.parent.iterdir():
        if found.name.startswith(out.name) and _PARTIAL.fullmatch(found.name[len(out.name) :]):
            with contextlib.suppress(OSError), _locked(found) as is_ours:
                if is_ours and all(inner.name == out.name and inner.is_dir() for inner in found.iterdir()):
                    shutil.rmtree(found)


def _sync(folder: Path) -> None:
    """Wait until a folder with all that is in it is on the disk."""
    for place, _, names in os.walk(folder):
        for name in names:
            descriptor = os.open(Path(place) / name, os.O_RDONLY | os.O_CLOEXEC)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        sync_folder(Path(place))


def _move(draft: Path, out: Path, aside: Path) -> None:
    if out.exists():
        out.rename(aside)
        try:
            draft.rename(out)
        except BaseException:
            aside.rename(out)
            raise
        sync_folder(out.parent)
        # Into the partial folder, which goes with all that is in it; if it cannot, the new one is in place nonetheless.
        aside.rename(draft)
    else:
        draft.rename(out)
    sync_folder(out.parent)
