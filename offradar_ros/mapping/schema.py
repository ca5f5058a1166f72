"""The tables of a map file: SQLite, one file for each map.

`places` holds the map; `undo` holds, for each place that a session changed, its content before that session (`existed`
0: the place did not exist). A session in state `running` was saved but not ended. An unknown yaw is NULL. `mean` is d
little-endian float32. `meta` values are JSON.
"""

from __future__ import annotations

APPLICATION_ID = 0x4F4D4150
"""`PRAGMA application_id` of a map, ASCII OMAP: it distinguishes a map from other SQLite files."""

VERSION = 1
"""`PRAGMA user_version`. A file of a newer version is refused."""

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
