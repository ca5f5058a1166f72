"""Map files of a few places, made by drives of thirty scans."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from offradar_ros.config import MapConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping import schema
from offradar_ros.mapping.map_reader import read_map
from offradar_ros.mapping.seal import SEALED_TABLES, Seal
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.stored_map import Before, StoredMap
from offradar_ros.mapping.whole_map import write_map
from offradar_ros.records import structure
from offradar_ros.types import Embedding, PlaceTable, Pose

MODEL = ModelInfo('ring_key', 'a' * 64, 3, {'rings': '3'})
OTHER = ModelInfo('variational', 'b' * 64, 3, {})
ORIGIN = GeoPoint(51.76, -1.25, 61.5)


def scan(stamp: int, uncertainty: float) -> Embedding:
    mean = np.random.default_rng(stamp).normal(size=3).astype(np.float32)
    signature = signature_of(stamp, uncertainty)
    return Embedding(stamp, mean, np.full(3, uncertainty, np.float32), MODEL.fingerprint, signature)


def signature_of(stamp: int, uncertainty: float) -> bytes:
    """What stands for the signature of a scan: any bytes do for a map. Some scans have none, some are of two pages."""
    size = 0 if stamp % 7 == 3 else 5000 if stamp % 16 == 0 else 30 + stamp % 90
    return np.random.default_rng([stamp, round(1000.0 * uncertainty)]).bytes(size)


def drive(session_map: SessionMap, uncertainty: float, start_m: float = 0.0) -> None:
    """Start a session and map thirty scans."""
    session_map.start_session('drive', 123456789)
    for metre in range(30):
        yaw = 0.1 * metre if metre % 2 else float('nan')
        sd_rad = 0.01 * metre if metre % 4 == 1 else float('nan')
        session_map.merge(scan(metre + 1, uncertainty), Pose(start_m + metre, 0.5, 1.5, yaw, sd_rad))


def make_map(path: Path, *uncertainties: float) -> PlaceTable:
    """A map with a session of each uncertainty; returns its places."""
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(MODEL)
        session_map.set_origin(ORIGIN)
        for uncertainty in uncertainties:
            drive(session_map, uncertainty)
            session_map.end_session()
        return session_map.places()


def open_map(path: Path, **options: Any) -> SessionMap:
    return SessionMap(MapConfig(path=str(path), **options))


def add_session(path: Path, uncertainty: float, start_m: float = 0.0) -> None:
    """Open the map, map a session and close it."""
    with open_map(path) as session_map:
        drive(session_map, uncertainty, start_m)
        session_map.end_session()


def assert_tables_equal(one: PlaceTable, other: PlaceTable) -> None:
    for field in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
        assert getattr(one, field.name).dtype == getattr(other, field.name).dtype


def assert_holds(path: Path, expected: StoredMap) -> None:
    """The map at `path` holds what `expected` does."""
    assert difference(read_map(path), expected) == ''


def difference(one: StoredMap, other: StoredMap) -> str:
    """The first thing in which the content of two maps differs, in words; '' if they are the same."""
    for name in ('model', 'origin', 'next_place_id', 'sessions'):
        if getattr(one, name) != getattr(other, name):
            return name
    if not _are_equal(one.places, other.places):
        return 'places'
    if not np.array_equal(one.anchors_m, other.anchors_m):
        return 'anchors'
    if one.signatures != other.signatures:
        return 'signatures'
    if one.before.keys() != other.before.keys():
        return 'undo'
    for session, before in one.before.items():
        changed = [(place_id, place is None) for place_id, place in before.items()]
        if changed != [(place_id, place is None) for place_id, place in other.before[session].items()]:
            return f'undo of session {session}'
        if not _are_equal(*(_table_of(stored.before[session], stored.columns.dimension) for stored in (one, other))):
            return f'undo of session {session}'
    return ''


def _table_of(before: Before, dimension: int) -> PlaceTable:
    return PlaceTable.from_places([place for place in before.values() if place], dimension)


def _are_equal(one: PlaceTable, other: PlaceTable) -> bool:
    pairs = [(getattr(one, field.name), getattr(other, field.name)) for field in dataclasses.fields(PlaceTable)]
    return all(a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def sessions_of(path: Path) -> list[tuple[int, str]]:
    return [(session.session_id, session.state) for session in read_map(path).sessions]


def folder_state(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.is_file()}


def change(path: Path, *statements: str) -> None:
    """Change a file by SQL, past all that writes maps."""
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)


def fail_to_write(*_: object) -> NoReturn:
    """In place of something that writes to a map: the disk is full."""
    raise sqlite3.OperationalError('database or disk is full')


def as_version_1(path: Path) -> None:
    """Rewrite the map at `path` as the first version of the format, without digests and signatures."""
    _rewrite(path, 1)


def as_version_2(path: Path) -> None:
    """Rewrite the map at `path` as the second version of the format, without signatures."""
    _rewrite(path, 2)


def as_version_3(path: Path) -> None:
    """Rewrite the map at `path` as the third version of the format, without standard deviations of headings."""
    _rewrite(path, 3)


def _without_heading_sds(stored: StoredMap) -> StoredMap:
    stored.columns.table.yaw_sds_rad[:] = np.nan
    before = {session: dict(places) for session, places in stored.before.items()}
    for places in before.values():
        for place_id, place in places.items():
            if place:
                places[place_id] = dataclasses.replace(place, pose=dataclasses.replace(place.pose, yaw_sd_rad=np.nan))
    return dataclasses.replace(stored, before=before)


def _rewrite(path: Path, version: int) -> None:
    # Their digests are those of rows without.
    write_map(path, _without_heading_sds(read_map(path)), overwrite=True)
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        rows = {}
        for name in (*SEALED_TABLES[3], 'signature_contents'):
            cursor = connection.execute(f'SELECT * FROM {name}')
            columns = [column for column, *_ in cursor.description]
            dropped = {'yaw_sd_rad'} if version > 1 else {'yaw_sd_rad', 'digest'}
            kept = [number for number, column in enumerate(columns) if column not in dropped]
            rows[name] = [[row[number] for number in kept] for row in cursor]
    path.unlink()
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.executescript(schema.OF_VERSION[version])
        for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall():
            for row in rows[name]:
                if version > 1 or row[0] != 'seal':
                    connection.execute(f'INSERT INTO {name} VALUES ({", ".join("?" * len(row))})', row)
        if version == 2:
            ((text,),) = connection.execute("SELECT value FROM meta WHERE key = 'seal'")
            tree = json.loads(text)
            del tree['sums']['signatures']
            structure(Seal, tree).write(connection)
        connection.execute(f'PRAGMA application_id = {schema.APPLICATION_ID}')
        connection.execute(f'PRAGMA user_version = {version}')
        connection.execute('PRAGMA journal_mode = WAL')


def killed(code: str, *arguments: object) -> None:
    """Run code in a process of its own that kills itself at the end with ``die()``."""
    die = 'import os, signal\ndef die(): os.kill(os.getpid(), signal.SIGKILL)\n'
    ended = run(die + textwrap.dedent(code), *arguments)
    assert ended.returncode == -signal.SIGKILL, ended.stderr


def run(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own, with this package and the tests' support to import."""
    root = Path(__file__).resolve().parents[2]
    paths = [str(root), str(Path(__file__).parent), os.environ.get('PYTHONPATH', '')]
    return subprocess.run(
        [sys.executable, '-c', textwrap.dedent(code), *map(str, arguments)],
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(paths)},
    )


LEAVE_A_LOG = """
    import sys
    from pathlib import Path
    from small_maps import drive, open_map
    from offradar_ros.mapping.store import MapStore
    # As a process that is killed after the commit and before the log has been moved into the file.
    session_map = open_map(Path(sys.argv[1]))
    drive(session_map, float(sys.argv[2]), float(sys.argv[3]))
    session_map.adopt_model(session_map.model)
    MapStore._fold_log = lambda store, connection: die()
    session_map.end_session()
"""


def leave_a_log(path: Path, uncertainty: float, start_m: float = 0.0) -> None:
    """Add a session by a process that is killed between its commit and the move of the log into the file."""
    killed(LEAVE_A_LOG, path, uncertainty, start_m)
    assert path.with_name(path.name + '-wal').stat().st_size
