"""A map of version 1 becomes one of version 2."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
from pathlib import Path

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import open_sqlite
from offradar_ros.mapping.stored_map import StoredMap
from offradar_ros.mapping.whole_map import utc_stamp, write_map
from offradar_ros.whole_file import sync_folder, whole_file


def upgrade(path: Path, stored: StoredMap) -> str:
    """Write `stored`, what the map of version 1 at `path` holds, there as version 2; says so in one line.

    The file is kept as ``<path>.v1.bak``. MapError if that fails; the map is then as it was.
    """
    try:
        # What is still in its log becomes part of the file that is kept.
        with contextlib.closing(open_sqlite(path, 'mode=rw')) as connection:
            connection.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        kept = _kept(path)
    except (OSError, sqlite3.Error) as error:
        raise MapError(f'{path}: the map of version 1 could not be kept beside its upgrade ({error})') from error
    write_map(path, stored, overwrite=True)
    return f'{path}: upgraded from map format 1 to 2; the file as it was is kept as {kept.name}'


def _kept(path: Path) -> Path:
    kept = path.with_name(f'{path.name}.v1.bak')
    if os.path.lexists(kept):
        if kept.samefile(path):
            # An upgrade that was cut off.
            return kept
        kept = path.with_name(f'{path.name}.v1.{utc_stamp()}.bak')
    try:
        os.link(path, kept)
        sync_folder(path.parent)
    except OSError:
        with path.open('rb') as source, whole_file(kept) as target:
            shutil.copyfileobj(source, target)
    return kept
