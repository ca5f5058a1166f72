"""A map of an earlier version becomes one of this version."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
from pathlib import Path

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import open_sqlite
from offradar_ros.mapping.schema import VERSION
from offradar_ros.mapping.stored_map import StoredMap
from offradar_ros.mapping.whole_map import utc_stamp, write_map
from offradar_ros.whole_file import sync_folder, whole_file


def upgrade(path: Path, stored: StoredMap) -> str:
    """Write `stored`, what the map of an earlier version at `path` holds, there as this version; says so in one line.

    The file is kept as ``<path>.v1.bak``, for version 1. MapError if that fails; the map is then as it was.
    """
    try:
        # What is still in its log becomes part of the file that is kept.
        with contextlib.closing(open_sqlite(path, 'mode=rw')) as connection:
            connection.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        kept = _kept(path, stored.version)
    except (OSError, sqlite3.Error) as error:
        raise MapError(
            f'{path}: the map of version {stored.version} could not be kept beside its upgrade ({error})'
        ) from error
    write_map(path, stored, overwrite=True)
    return f'{path}: upgraded from map format {stored.version} to {VERSION}; the file as it was is kept as {kept.name}'


def _kept(path: Path, version: int) -> Path:
    kept = path.with_name(f'{path.name}.v{version}.bak')
    if os.path.lexists(kept):
        if kept.samefile(path):
            # An upgrade that was cut off.
            return kept
        kept = path.with_name(f'{path.name}.v{version}.{utc_stamp()}.bak')
    try:
        os.link(path, kept)
        sync_folder(path.parent)
    except OSError:
        with path.open('rb') as source, whole_file(kept) as target:
            shutil.copyfileobj(source, target)
    return kept
