"""A log that lies beside a map file is applied only if it continues what the file holds; it is never deleted."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
import sqlite3
from pathlib import Path

import pytest
from small_maps import (
    MODEL,
    add_session,
    as_version_1,
    assert_holds,
    assert_tables_equal,
    folder_state,
    killed,
    leave_a_log,
    make_map,
    open_map,
    sessions_of,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import log_of, read_committed, read_map, rollback_log_of
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.mapping.seal import RowSum, Seal


def stale_logs(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if '.stale-' in path.name)


def assert_used_without_its_log(path: Path, expected: Path) -> None:
    """The map is read as the file alone, and a writer keeps the log under another name."""
    content, log = read_map(expected), log_of(path).read_bytes()
    before = folder_state(path.parent)
    stored = read_map(path)
    assert stored.is_log_foreign
    assert_holds(path, content)
    _, columns = read_committed(path, PlaceColumns)
    assert_tables_equal(columns.table, content.committed())
    assert {name: digest for name, digest in folder_state(path.parent).items() if not name.endswith('-shm')} == {
        name: digest for name, digest in before.items() if not name.endswith('-shm')
    }
    with open_map(path) as session_map:
        (notice,) = session_map.notices
        assert 'does not belong to the map and was not applied' in notice and str(path) in notice
        assert_tables_equal(session_map.places(), content.places)
    (kept,) = stale_logs(path.parent)
    assert kept.name in notice
    assert kept.read_bytes() == log
    assert not log_of(path).exists()
    assert_holds(path, content)
    add_session(path, 0.01)
    assert len(read_map(path).sessions) == len(content.sessions) + 1


def test_the_log_of_a_killed_writer_is_applied(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    leave_a_log(path, 0.5, 100.0)
    stored = read_map(path)
    assert [session.state for session in stored.sessions] == ['ended', 'ended']
    assert not stored.is_log_foreign
    with open_map(path) as session_map:
        assert session_map.notices == ()
        assert_tables_equal(session_map.places(), stored.places)
        session_map.undo_session()
    assert sessions_of(path) == [(1, 'ended'), (2, 'undone')]
    assert stale_logs(tmp_path) == []


def test_a_reader_makes_the_index_of_a_log_and_changes_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    leave_a_log(path, 0.5, 100.0)
    (tmp_path / 'a.map-shm').unlink(missing_ok=True)
    before = folder_state(tmp_path)
    read_map(path)
    after = folder_state(tmp_path)
    assert after.keys() - before.keys() <= {'a.map-shm'}
    assert {name: after[name] for name in before} == before


def test_a_map_copied_over_another_is_not_changed_by_the_log_of_that(tmp_path: Path) -> None:
    path, other = tmp_path / 'a.map', tmp_path / 'elsewhere' / 'b.map'
    other.parent.mkdir()
    make_map(path, 1.0)
    make_map(other, 0.9, 0.8)
    leave_a_log(path, 0.5, 100.0)
    shutil.copy(other, path)
    assert_used_without_its_log(path, other)


def test_an_older_copy_of_a_map_is_not_changed_by_its_newer_log(tmp_path: Path) -> None:
    path, older = tmp_path / 'a.map', tmp_path / 'elsewhere' / 'older.map'
    older.parent.mkdir()
    make_map(path, 1.0)
    shutil.copy(path, older)
    add_session(path, 0.7)
    leave_a_log(path, 0.5, 100.0)
    shutil.copy(older, path)
    assert_used_without_its_log(path, older)


def test_a_newer_copy_of_a_map_is_not_changed_by_an_older_log(tmp_path: Path) -> None:
    path, newer = tmp_path / 'a.map', tmp_path / 'elsewhere' / 'newer.map'
    newer.parent.mkdir()
    make_map(path, 1.0)
    shutil.copy(path, newer)
    for uncertainty in (0.9, 0.8, 0.7):
        add_session(newer, uncertainty)
    leave_a_log(path, 0.5, 100.0)
    shutil.copy(newer, path)
    assert_used_without_its_log(path, newer)


def test_a_copy_that_went_its_own_way_is_not_changed_by_the_log_of_its_origin(tmp_path: Path) -> None:
    """Both have the same identity, and are as many transactions old."""
    path, copy = tmp_path / 'a.map', tmp_path / 'elsewhere' / 'copy.map'
    copy.parent.mkdir()
    make_map(path, 1.0)
    shutil.copy(path, copy)
    add_session(path, 0.7)
    add_session(copy, 0.6)
    leave_a_log(path, 0.5, 100.0)
    shutil.copy(copy, path)
    assert_used_without_its_log(path, copy)


def test_a_map_copied_without_its_log_is_the_last_that_was_moved_into_the_file(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    content = read_map(path)
    leave_a_log(path, 0.5, 100.0)
    log_of(path).unlink()
    path.with_name('a.map-shm').unlink()
    assert_holds(path, content)


def test_the_index_of_the_log_is_not_needed(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    leave_a_log(path, 0.5, 100.0)
    path.with_name('a.map-shm').unlink()
    assert sessions_of(path) == [(1, 'ended'), (2, 'ended')]
    with open_map(path) as session_map:
        assert session_map.start_session('next', 1) == 3


LOG_OF_VERSION_1 = """
    import sqlite3, sys
    connection = sqlite3.connect(sys.argv[1], isolation_level=None)
    connection.execute('PRAGMA wal_autocheckpoint = 0')
    connection.execute('BEGIN')
    connection.execute("UPDATE sessions SET name = 'in the log'")
    # Written with each session.
    connection.execute("REPLACE INTO meta VALUES ('next_place_id', '6')")
    connection.execute('COMMIT')
    die()
"""


def test_the_log_of_an_old_version_is_applied_before_the_upgrade(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    as_version_1(path)
    killed(LOG_OF_VERSION_1, path)
    assert [session.name for session in read_map(path).sessions] == ['in the log']
    with open_map(path) as session_map:
        (notice,) = session_map.notices
    assert 'upgraded' in notice
    for file in (path, tmp_path / 'a.map.v1.bak'):
        assert [session.name for session in read_map(file).sessions] == ['in the log']


@pytest.mark.parametrize(('version_of_map', 'sessions'), [(1, 1), (1, 2), (2, 1), (2, 2)])
def test_the_log_of_another_map_of_the_old_version_is_not_applied(
    tmp_path: Path, version_of_map: int, sessions: int
) -> None:
    path, other = tmp_path / 'a.map', tmp_path / 'elsewhere' / 'b.map'
    other.parent.mkdir()
    make_map(path, 1.0)
    as_version_1(path)
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("""UPDATE meta SET value = '"2020-01-01T00:00:00+00:00"' WHERE key = 'created'""")
    make_map(other, *(0.9, 0.8)[:sessions])
    if version_of_map == 1:
        as_version_1(other)
    content = read_map(other)
    killed(LOG_OF_VERSION_1, path)
    shutil.copy(other, path)
    assert read_map(path).is_log_foreign
    assert_holds(path, content)
    with open_map(path) as session_map:
        assert_tables_equal(session_map.places(), content.places)
    assert len(stale_logs(tmp_path)) == 1


LEAVE_A_ROLLBACK_LOG = """
    import sqlite3, sys
    connection = sqlite3.connect(sys.argv[1], isolation_level=None)
    connection.execute('PRAGMA journal_mode = DELETE')
    connection.execute('PRAGMA cache_size = 1')
    connection.execute('BEGIN')
    connection.execute('UPDATE places SET x_m = 5.0')
    connection.execute('CREATE TABLE large AS SELECT randomblob(1000000)')
    die()
"""


def test_a_rollback_log_beside_a_map_is_not_applied(tmp_path: Path) -> None:
    """SQLite would write the pages of the other file into the map when it opens it."""
    path, other = tmp_path / 'a.map', tmp_path / 'elsewhere' / 'b.map'
    other.parent.mkdir()
    make_map(path, 1.0)
    make_map(other, 0.9)
    content = read_map(other)
    killed(LEAVE_A_ROLLBACK_LOG, path)
    assert rollback_log_of(path).stat().st_size
    shutil.copy(other, path)
    assert_holds(path, content)
    with open_map(path) as session_map:
        assert 'a.map-journal does not belong to the map' in session_map.notices[0]
        assert_tables_equal(session_map.places(), content.places)
    add_session(path, 0.5)
    assert len(stale_logs(tmp_path)) == 1


def test_the_log_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / 'diary.db'
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute('CREATE TABLE places (x_m)')
    killed(LEAVE_A_ROLLBACK_LOG, path)
    before = folder_state(tmp_path)
    with pytest.raises(MapError, match='not a map'):
        open_map(path)
    assert folder_state(tmp_path) == before


@pytest.mark.parametrize('suffix', ['-wal', '-journal'])
def test_a_new_map_is_not_filled_by_a_log_that_was_left(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    if suffix == '-wal':
        leave_a_log(path, 0.5, 100.0)
    else:
        killed(LEAVE_A_ROLLBACK_LOG, path)
    log = path.with_name(path.name + suffix)
    left = log.read_bytes()
    path.unlink()
    with open_map(path) as session_map:
        assert len(session_map) == 0 and session_map.model is None
        assert f'{log.name} does not belong' in session_map.notices[0]
    (kept,) = stale_logs(tmp_path)
    assert kept.read_bytes() == left


def test_a_log_needed_by_a_half_written_file_is_applied(tmp_path: Path) -> None:
    """As after a power cut while the log was moved into the file: pages of the file are new, old and torn."""
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.9)
    leave_a_log(path, 0.5, 100.0)
    content = read_map(path)
    moved = tmp_path / 'moved' / 'a.map'
    moved.parent.mkdir()
    for suffix in ('', '-wal'):
        shutil.copy(f'{path}{suffix}', f'{moved}{suffix}')
    with open_map(moved) as session_map:
        session_map.adopt_model(MODEL)
    complete, half = moved.read_bytes(), bytearray(path.read_bytes())
    pages = [
        start for start in range(0, len(half), 4096) if half[start : start + 4096] != complete[start : start + 4096]
    ]
    assert len(pages) > 1
    half[pages[0] : pages[0] + 4096] = complete[pages[0] : pages[0] + 4096]
    half[pages[1] + 512 : pages[1] + 4096] = bytes(4096 - 512)
    path.write_bytes(half)
    assert_holds(path, content)
    add_session(path, 0.4, 200.0)
    assert [state for _, state in sessions_of(path)] == ['ended'] * 4
    assert stale_logs(tmp_path) == []


def test_a_log_that_could_not_be_moved_by_the_next_writer_either_is_still_applied(tmp_path: Path) -> None:
    """A reader keeps two writers, one after the other, from moving the log into the file; both are killed."""
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    leave_a_log(path, 0.5, 100.0)
    code = """
        import sqlite3, sys
        from small_maps import *
        reader = sqlite3.connect(f'file:{sys.argv[1]}?mode=ro', uri=True, isolation_level=None)
        reader.execute('BEGIN')
        reader.execute('SELECT count(*) FROM places').fetchone()
        session_map = open_map(Path(sys.argv[1]))
        for start_m in (200.0, 300.0):
            drive(session_map, 0.4, start_m)
            session_map.end_session()
        die()
    """
    for _ in range(2):
        killed(code, path)
    stored = read_map(path)
    assert not stored.is_log_foreign
    assert [session.state for session in stored.sessions] == ['ended'] * 6
    add_session(path, 0.3)
    assert len(sessions_of(path)) == 7
    assert stale_logs(tmp_path) == []


def test_a_log_continues_what_was_last_in_the_file_for_sure_or_came_after_it() -> None:
    seals = [Seal.new()]
    for is_folded in (True, True, False, False):
        seals.append(seals[-1].next(seals[-1].sums, is_folded=is_folded))
    newest = seals[-1]
    # The second one was in the file for sure, the two after it perhaps.
    assert [newest.follows(alone) for alone in seals] == [False, True, True, True, True]
    assert not seals[2].follows(newest)
    other = seals[3].next({**newest.sums, 'places': RowSum(1, 7)}, is_folded=False)
    assert not newest.follows(other)
    assert not any(newest.follows(dataclasses.replace(alone, identity='0' * 32)) for alone in seals)
