"""The tables of a map file: SQLite, one file a map.

`places` holds the map as it is; `undo` what each place that a session changed held before it (`existed` 0: nothing).
A session whose state is `running` was saved but not ended. NULL stands for an unknown yaw. `mean` is d little-endian
float32. `meta` values are JSON.
"""

from __future__ import annotations

APPLICATION_ID = 0x4F4D4150
"""`PRAGMA application_id` of a map, ASCII OMAP: how a map is told from other SQLite files."""

VERSION = 1
"""`PRAGMA user_version`. A file of a newer version is refused, never guessed at."""

_CONTENT = """
    session_id INTEGER {null}, stamp_ns INTEGER {null}, x_m REAL {null}, y_m REAL {null}, z_m REAL {null},
    yaw_rad REAL, uncertainty REAL {null}, mean BLOB {null}
"""

CREATE = f"""
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE sessions (
    session_id INTEGER PRIMARY KEY, name TEXT NOT NULL, stamp_ns INTEGER NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('running', 'ended', 'interrupted', 'undone')), report TEXT NOT NULL
);
CREATE TABLE places (
    place_id INTEGER PRIMARY KEY, {_CONTENT.format(null='NOT NULL')},
    anchor_x_m REAL NOT NULL, anchor_y_m REAL NOT NULL
);
CREATE TABLE undo (
    by_session INTEGER NOT NULL, place_id INTEGER NOT NULL, existed INTEGER NOT NULL, {_CONTENT.format(null='')},
    PRIMARY KEY (by_session, place_id)
);
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
"""
