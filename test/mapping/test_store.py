"""Sessions on disk are safe against a killed process, and invalid files are not changed."""

import contextlib
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_maps import (
    MODEL,
    ORIGIN,
    OTHER,
    assert_tables_equal,
    change,
    drive,
    fail_to_write,
    folder_state,
    make_map,
    open_map,
    scan,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping import schema
from offradar_ros.mapping.map_reader import read_committed
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.mapping.place_rows import rows_to_table, table_to_rows
from offradar_ros.mapping.store import MapStore
from offradar_ros.types import Place, PlaceTable, Pose


def test_a_map_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    places = make_map(path, 1.0, 0.5)
    assert [file.name for file in tmp_path.iterdir()] == ['a.map']
    with open_map(path) as session_map:
        assert_tables_equal(session_map.places(), places)
        assert_tables_equal(session_map.committed(), places)
        assert (session_map.model, session_map.origin) == (MODEL, ORIGIN)
        assert session_map.start_session('next', 1) == 3


def test_anchors_are_stored(tmp_path: Path) -> None:
    """The last scan is within D_t of the anchor of a replaced place, but not of its present position."""
    path = tmp_path / 'a.map'
    with open_map(path) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('one', 1)
        session_map.merge(scan(1, 1.0), Pose(0.0, 0.0))
        session_map.merge(scan(2, 0.5), Pose(4.0, 0.0))
        session_map.end_session()
    with open_map(path) as session_map:
        session_map.start_session('two', 2)
        assert session_map.merge(scan(3, 0.9), Pose(-4.0, 0.0)).kind.value == 'kept'


def test_sessions_can_be_undone_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    first = make_map(path, 1.0)
    with open_map(path) as session_map:
        drive(session_map, 0.5, start_m=15.0)
        session_map.end_session()
    with open_map(path) as session_map:
        report = session_map.undo_session()
        assert report.removed and report.restored
        assert_tables_equal(session_map.places(), first)
    with open_map(path) as session_map:
        assert_tables_equal(session_map.places(), first)
        assert session_map.undo_session().session_id == 1
        with pytest.raises(MapError, match='no session to undo'):
            session_map.undo_session()
    with open_map(path) as session_map:
        assert len(session_map) == 0
        assert session_map.start_session('next', 1) == 3


def test_undo_depth_applies_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    with open_map(path, undo_depth=2) as session_map:
        session_map.adopt_model(MODEL)
        for uncertainty in (1.0, 0.9, 0.8, 0.7):
            drive(session_map, uncertainty)
            session_map.end_session()
    with open_map(path, undo_depth=9) as session_map:
        assert [session_map.undo_session().session_id for _ in range(2)] == [4, 3]
        with pytest.raises(MapError):
            session_map.undo_session()
        assert session_map.mean_uncertainty == pytest.approx(0.9)


DRIVE_AND_KILL = """
    import os, signal, sys
    import numpy as np
    from offradar_ros.config import MapConfig
    from offradar_ros.encoders.protocol import ModelInfo
    from offradar_ros.mapping.sessions import SessionMap
    from offradar_ros.types import Embedding, Pose

    path, last_call = sys.argv[1:]
    session_map = SessionMap(MapConfig(path=path))
    session_map.adopt_model(ModelInfo('ring_key', 'a' * 64, 3, {'rings': '3'}))
    for session, uncertainty in enumerate((1.0, 0.5)):
        session_map.start_session('drive', session)
        for metre in range(40):
            mean = np.full(3, metre, np.float32)
            variance = np.full(3, uncertainty, np.float32)
            pose = Pose(20.0 * session + metre, 0.0)
            session_map.merge(Embedding(session * 100 + metre, mean, variance, 'a' * 64), pose)
        if session == 0 or last_call == 'end':
            session_map.end_session()
        elif last_call == 'save':
            session_map.save()
    np.savez(path + '.npz', places=session_map.places().stamps_ns, committed=session_map.committed().stamps_ns)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def killed_after(path: Path, last_call: str) -> dict[str, Any]:
    command = [sys.executable, '-c', textwrap.dedent(DRIVE_AND_KILL), str(path), last_call]
    root = str(Path(__file__).resolve().parents[2])
    environment = os.environ | {'PYTHONPATH': os.pathsep.join([root, os.environ.get('PYTHONPATH', '')])}
    killed = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    with np.load(f'{path}.npz') as held:
        return {name: held[name].tolist() for name in held}


def test_an_ended_session_is_on_disk_after_a_kill(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    held = killed_after(path, 'end')
    with open_map(path) as session_map:
        assert session_map.places().stamps_ns.tolist() == held['places']
        assert session_map.undo_session().session_id == 2


def test_a_session_that_was_not_saved_is_not_on_disk_after_a_kill(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    held = killed_after(path, 'nothing')
    assert held['places'] != held['committed']
    with open_map(path) as session_map:
        assert session_map.places().stamps_ns.tolist() == held['committed']
        assert session_map.undo_session().session_id == 1


def test_a_saved_session_is_interrupted_by_a_kill_and_can_be_undone(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    held = killed_after(path, 'save')
    assert MapStore.open_read_only(path).committed().stamps_ns.tolist() == held['committed']
    with open_map(path) as session_map:
        session_map.adopt_model(MODEL)
        assert session_map.committed().stamps_ns.tolist() == held['places']
    stored = MapStore.open_read_only(path)
    assert [session.state for session in stored.sessions] == ['ended', 'interrupted']
    assert stored.committed().stamps_ns.tolist() == held['places']
    with open_map(path) as session_map:
        assert session_map.undo_session().session_id == 2
        assert session_map.places().stamps_ns.tolist() == held['committed']


def test_a_reader_sees_ended_sessions_while_another_runs(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    with open_map(path) as writer:
        writer.adopt_model(MODEL)
        assert len(MapStore.open_read_only(path).committed()) == 0
        drive(writer, 1.0)
        writer.end_session()
        assert_tables_equal(MapStore.open_read_only(path).committed(), writer.committed())
        drive(writer, 0.5, start_m=10.0)
        for save in (False, True):
            if save:
                writer.save()
            stored = MapStore.open_read_only(path)
            assert_tables_equal(stored.committed(), writer.committed())
            assert stored.model == MODEL
        assert_tables_equal(stored.places, writer.places())
        writer.end_session()
        assert_tables_equal(MapStore.open_read_only(path).committed(), writer.places())
    assert_tables_equal(MapStore.open_read_only(path).committed(), writer.places())
    assert [file.name for file in tmp_path.iterdir()] == ['a.map']


def test_a_reader_that_starts_again_frees_the_first_copy_before(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 0.5)
    alive = weakref.WeakSet[PlaceColumns]()
    started: list[int] = []

    def start(dimension: int, capacity: int) -> PlaceColumns:
        started.append(len(alive))
        if len(started) == 1:
            make_map(path, 0.4)
        columns = PlaceColumns(dimension, capacity)
        alive.add(columns)
        return columns

    _, columns = read_committed(path, start)
    assert started == [0, 0]
    assert_tables_equal(columns.table, MapStore.open_read_only(path).committed())


def test_saved_sessions_that_continue_or_are_discarded(
    tmp_path: Path,
) -> None:
    path = tmp_path / 'a.map'
    first = make_map(path, 1.0)
    with open_map(path) as session_map:
        session_map.start_session('two', 2)
        for metre in range(60):
            session_map.merge(scan(1000 + metre, 0.5 if metre % 3 else 0.25), Pose(float(metre), 0.0))
            if metre % 20 == 0:
                session_map.save()
        session_map.undo_session()
        assert_tables_equal(MapStore.open_read_only(path).committed(), first)
        assert_tables_equal(MapStore.open_read_only(path).places, first)
        session_map.start_session('three', 3)
        session_map.merge(scan(2000, 0.1), Pose(0.0, 0.0))
        session_map.save()
        session_map.merge(scan(2001, 0.05), Pose(0.0, 0.0))
        session_map.end_session()
        held = session_map.places()
    with open_map(path) as session_map:
        assert_tables_equal(session_map.places(), held)
        session_map.undo_session()
        assert_tables_equal(session_map.places(), first)


def test_a_second_writer_is_refused_until_the_first_closes(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    with open_map(path), pytest.raises(MapError, match='in use by another process'):
        open_map(path)
    open_map(path).close()


def test_a_killed_writer_holds_no_lock(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    killed_after(path, 'end')
    open_map(path).close()


def truncated(path: Path) -> None:
    make_map(path, 1.0)
    path.write_bytes(path.read_bytes()[:-5000])


def overwritten_inside(path: Path) -> None:
    make_map(path, 1.0)
    content = bytearray(path.read_bytes())
    content[16384:49152] = os.urandom(32768)
    path.write_bytes(content)


def of_a_newer_version(path: Path) -> None:
    make_map(path, 1.0)
    change(path, f'PRAGMA user_version = {schema.VERSION + 1}')


def with_a_short_mean(path: Path) -> None:
    make_map(path, 1.0)
    change(path, "UPDATE places SET mean = x'00000000' WHERE place_id = 2")


def with_a_mean_of_nan(path: Path) -> None:
    make_map(path, 1.0)
    change(path, "UPDATE places SET mean = x'0000c07f0000c07f0000c07f' WHERE place_id = 2")


def with_text_for_a_number(path: Path) -> None:
    make_map(path, 1.0)
    change(path, "UPDATE places SET stamp_ns = 'yesterday'")


def without_its_meta(path: Path) -> None:
    make_map(path, 1.0)
    change(path, "DELETE FROM meta WHERE key = 'next_place_id'")


def with_an_origin_off_the_earth(path: Path) -> None:
    make_map(path, 1.0)
    change(path, """UPDATE meta SET value = '{"latitude_deg": 99, "longitude_deg": 0}' WHERE key = 'origin'""")


def another_sqlite_file(path: Path) -> None:
    change(path, 'CREATE TABLE diary (day TEXT)')


def another_sqlite_file_with_a_log(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute('PRAGMA journal_mode = WAL')
    connection.execute('CREATE TABLE diary (day TEXT)')
    connection.close()


def not_sqlite(path: Path) -> None:
    path.write_text('stamp,x,y\n' * 1000)


def empty(path: Path) -> None:
    path.touch()


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (truncated, 'damaged'),
        (overwritten_inside, 'damaged'),
        (of_a_newer_version, 'newer version of offradar'),
        (with_a_short_mean, 'damaged'),
        (with_a_mean_of_nan, 'damaged'),
        (with_text_for_a_number, 'damaged'),
        (without_its_meta, 'damaged'),
        (with_an_origin_off_the_earth, 'damaged'),
        (another_sqlite_file, 'not a map written by offradar'),
        (another_sqlite_file_with_a_log, 'not a map written by offradar'),
        (not_sqlite, 'not a map'),
        (empty, 'empty file'),
    ],
)
def test_invalid_files_are_refused_and_not_changed(tmp_path: Path, make: Callable[[Path], None], words: str) -> None:
    path = tmp_path / 'a.map'
    make(path)
    before = folder_state(tmp_path)
    for opener in (open_map, MapStore.open_read_only, lambda path: read_committed(path, PlaceColumns)):
        with pytest.raises(MapError, match=words) as refused:
            opener(path)
        assert '\n' not in str(refused.value) and str(path) in str(refused.value)
        assert folder_state(tmp_path) == before


def test_a_map_of_another_model_is_refused_and_not_changed(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    before = folder_state(tmp_path)
    with open_map(path) as session_map, pytest.raises(MapError, match='use that model, or another'):
        session_map.adopt_model(OTHER)
    assert folder_state(tmp_path) == before


def test_opening_and_closing_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    before = folder_state(tmp_path)
    open_map(path).close()
    MapStore.open_read_only(path)
    assert folder_state(tmp_path) == before


def test_file_names_with_special_characters_of_a_uri(tmp_path: Path) -> None:
    path = tmp_path / 'a map?mode=memory#1%20.map'
    places = make_map(path, 1.0)
    assert_tables_equal(MapStore.open_read_only(path).places, places)


def test_paths_that_cannot_hold_a_map(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    (tmp_path / 'folder').mkdir()
    for path in (tmp_path / 'missing' / 'a.map', tmp_path / 'file' / 'a.map', tmp_path / 'folder'):
        with pytest.raises(MapError) as refused:
            open_map(path)
        assert str(path) in str(refused.value) and '\n' not in str(refused.value)
    with pytest.raises(MapError, match='no map file there'):
        MapStore.open_read_only(tmp_path / 'nowhere.map')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'folder']


def test_a_failed_write_leaves_file_and_session_unchanged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'a.map'
    first = make_map(path, 1.0)
    with open_map(path) as session_map:
        drive(session_map, 0.5)
        with monkeypatch.context() as patch:
            patch.setattr('offradar_ros.mapping.sealed_rows.SealedRows.put_places', fail_to_write)
            for call in (session_map.end_session, session_map.save):
                with pytest.raises(MapError, match='could not be written'):
                    call()
        assert_tables_equal(MapStore.open_read_only(path).places, first)
        report = session_map.end_session()
        assert report.replaced
        assert_tables_equal(MapStore.open_read_only(path).committed(), session_map.places())


@pytest.mark.parametrize('fails', ['_open_connection', '_close_connection'])
def test_a_map_that_cannot_be_closed_properly_is_let_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    path = tmp_path / 'a.map'
    session_map = open_map(path)
    session_map.adopt_model(MODEL)
    drive(session_map, 1.0)
    session_map.end_session()
    with monkeypatch.context() as patch, contextlib.suppress(sqlite3.Error):
        patch.setattr(MapStore, fails, fail_to_write)
        session_map.close()
    with open_map(path) as again:
        assert len(again) == 6


def test_clear_keeps_a_copy_of_everything(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    places = make_map(path, 1.0, 0.5)
    with open_map(path) as session_map:
        copy = session_map.clear()
        assert session_map.model == MODEL
        assert session_map.origin is None
        with pytest.raises(MapError, match='no session to undo'):
            session_map.undo_session()
    assert copy is not None
    assert copy.name.startswith('a.map.') and copy.name.endswith('Z.bak')
    assert_tables_equal(MapStore.open_read_only(copy).places, places)
    with open_map(path) as session_map:
        assert len(session_map) == 0
        session_map.adopt_model(OTHER)


finite = st.floats(-1e8, 1e8)
place = st.builds(
    Place,
    place_id=st.integers(0, 2**62),
    session_id=st.integers(0, 2**31 - 1),
    stamp_ns=st.integers(0, 2**62),
    pose=st.builds(Pose, finite, finite, finite, *[st.floats(-3.0, 3.0) | st.just(float('nan'))] * 2),
    uncertainty=st.floats(0.0, 1e6, width=32),
    mean=st.lists(st.floats(-1e6, 1e6, width=32), min_size=3, max_size=3).map(lambda v: np.array(v, np.float32)),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(place, max_size=5))
def test_rows_round_trip_through_sqlite(places: list[Place]) -> None:
    table = PlaceTable.from_places(places, 3)
    connection = sqlite3.connect(':memory:')
    connection.execute('CREATE TABLE t (a, b, c, d REAL, e REAL, f REAL, g REAL, h REAL, i REAL, j BLOB)')
    connection.executemany('INSERT INTO t VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)', table_to_rows(table))
    assert_tables_equal(rows_to_table(connection.execute('SELECT * FROM t ORDER BY rowid').fetchall(), 3), table)
