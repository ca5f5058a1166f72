"""A folder that appears under its name only when it is complete: a bag or a data-set folder."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.errors import DataError


@contextlib.contextmanager
def new_folder(out: Path, *, overwrite: bool, mark: str = 'metadata.yaml') -> Iterator[Path]:
    """Yields the folder to write, which is moved to `out` at the end, and removed if the block raises.

    It is named like `out`, because a recording's file is named after its folder, and lies in ``OUT.partial``. DataError
    if `out` exists and may not be replaced (only a folder with a file named `mark` may: by default, a bag), if files of
    somebody else are in the way, or if it cannot be written.
    """
    _require_name(out)
    partial, aside = out.with_name(out.name + '.partial'), out.with_name(out.name + '.replaced')
    try:
        _require_free(out, overwrite, mark)
        _require_own_partial(partial, out.name)
        if os.path.lexists(aside):
            raise DataError(f'{aside}: in the way, left by a run that was cut off: move it to {out} or remove it')
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        try:
            yield partial / out.name
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


def _require_own_partial(partial: Path, name: str) -> None:
    """DataError where `partial` holds anything but the folder that an earlier run wrote."""
    if not os.path.lexists(partial):
        return
    ours = partial.is_dir() and not partial.is_symlink()
    if not ours or any(found.name != name or not found.is_dir() for found in partial.iterdir()):
        raise DataError(f'{partial}: in the way, and not left by an earlier run: move it or remove it')


def _move(draft: Path, out: Path, aside: Path) -> None:
    if not out.exists():
        draft.rename(out)
        return
    out.rename(aside)
    try:
        draft.rename(out)
    except BaseException:
        aside.rename(out)
        raise
    shutil.rmtree(aside)
