"""The tables of a map file: SQLite, one file for each map.

`places` holds the map; `undo` holds, for each place that a session changed, its content before that session (`existed`
0: the place did not exist). A session in state `running` was saved but not ended. An unknown yaw is NULL, and so is an
unknown standard deviation of it. `mean` is d little-endian float32. `meta` values are JSON. Each row has a digest of
itself; the row `seal` of `meta` counts and sums the digests of all others (see `seal`).

`signatures` has those of the scans that `places` and `undo` hold, as far as they have one. Its digest is that of the
content too, which stands apart, so that all digests can be summed without reading megabytes.

Version 1 had no digests, version 2 no signatures, version 3 no standard deviations of headings. They are read, and
replaced by version 4 when they are opened to be written.
"""

from __future__ import annotations

import contextlib
import functools
import sqlite3

APPLICATION_ID = 0x4F4D4150
"""`PRAGMA application_id` of a map, ASCII OMAP: it distinguishes a map from other SQLite files."""

VERSION = 4
"""`PRAGMA user_version`. A file of a newer version is refused."""

_CONTENT = """
    session_id INTEGER {null}, stamp_ns INTEGER {null}, x_m REAL {null}, y_m REAL {null}, z_m REAL {null},
    yaw_rad REAL, {sd}uncertainty REAL {null}, mean BLOB {null}
"""

_TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL{digest}){keyed};
CREATE TABLE sessions (
    session_id INTEGER PRIMARY KEY, name TEXT NOT NULL, stamp_ns INTEGER NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('running', 'ended', 'interrupted', 'undone')), report TEXT NOT NULL{digest}
);
CREATE TABLE places (
    place_id INTEGER PRIMARY KEY, {filled},
    anchor_x_m REAL NOT NULL, anchor_y_m REAL NOT NULL{digest}
);
CREATE TABLE undo (
    by_session INTEGER NOT NULL, place_id INTEGER NOT NULL, existed INTEGER NOT NULL, {empty}{digest},
    PRIMARY KEY (by_session, place_id)
){keyed};
"""
_SIGNATURE_TABLES = """
CREATE TABLE signatures (
    session_id INTEGER NOT NULL, stamp_ns INTEGER NOT NULL, content_id INTEGER NOT NULL, digest INTEGER NOT NULL,
    PRIMARY KEY (session_id, stamp_ns)
) WITHOUT ROWID;
CREATE TABLE signature_contents (content_id INTEGER PRIMARY KEY, content BLOB NOT NULL);
"""


def _tables(digest: str, keyed: str, sd: str = '') -> str:
    filled, empty = _CONTENT.format(null='NOT NULL', sd=sd), _CONTENT.format(null='', sd=sd)
    return _TABLES.format(digest=digest, keyed=keyed, filled=filled, empty=empty)


# Without row ids there is no index beside these tables that could contradict them.
_SEALED = ', digest INTEGER NOT NULL', ' WITHOUT ROWID'
# Signatures of 2 to 3 kB fill smaller pages badly: the file would be larger by a quarter.
CREATE = f"""PRAGMA page_size = 16384;
{_tables(*_SEALED, 'yaw_sd_rad REAL, ')}{_SIGNATURE_TABLES}
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
"""
OF_VERSION = {1: _tables('', ''), 2: _tables(*_SEALED), 3: _tables(*_SEALED) + _SIGNATURE_TABLES, 4: CREATE}
"""The statements that make the tables of each version."""

Objects = frozenset[tuple[object, ...]]


def objects(connection: sqlite3.Connection) -> Objects:
    """Every table, index, view and trigger of a file, with the statement that made it."""
    return frozenset(connection.execute('SELECT type, name, tbl_name, sql FROM sqlite_master'))


@functools.cache
def expected_objects(version: int) -> Objects:
    """`objects` of a map of this version; a file from elsewhere could hold more, such as triggers."""
    with contextlib.closing(sqlite3.connect(':memory:')) as connection:
        connection.executescript(OF_VERSION[version])
        return objects(connection)
