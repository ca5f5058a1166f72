"""A map file that is removed, replaced, overwritten, locked or full: never a success that is none, and nothing lost."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
from small_maps import (
    MODEL,
    add_session,
    assert_tables_equal,
    difference,
    drive,
    folder_state,
    killed,
    make_map,
    open_map,
    run,
    scan,
    sessions_of,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping.held_file import HeldFile
from offradar_ros.mapping.map_reader import log_of, read_map
from offradar_ros.mapping.sealed_rows import SealedRows
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.stored_map import StoredMap, StoredSession
from offradar_ros.mapping.whole_map import back_up
from offradar_ros.types import Pose


def removed(path: Path) -> None:
    for file in path.parent.glob(f'{path.name}*'):
        file.unlink()


def removed_alone(path: Path) -> None:
    path.unlink()


def moved_away(path: Path) -> None:
    path.rename(path.with_name('elsewhere.map'))


def without_its_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


def replaced_by_another(path: Path) -> None:
    make_map(path.with_name('other.map'), 0.3)
    path.with_name('other.map').replace(path)


def replaced_by_an_older_copy(path: Path) -> None:
    shutil.copy(path.parent.parent / 'older.map', path.with_name('draft'))
    path.with_name('draft').replace(path)


def replaced_by_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def replaced_by_a_link(path: Path) -> None:
    make_map(path.with_name('other.map'), 0.3)
    path.unlink()
    path.symlink_to('other.map')


def overwritten_by_another(path: Path) -> None:
    make_map(path.with_name('other.map'), 0.3)
    copy_over(path.with_name('other.map'), path)


def overwritten_by_an_older_copy(path: Path) -> None:
    copy_over(path.parent.parent / 'older.map', path)


def overwritten_by_the_copy_before_the_last_session(path: Path) -> None:
    copy_over(path.parent.parent / 'before.map', path)


def truncated(path: Path) -> None:
    os.truncate(path, 4096)


def emptied(path: Path) -> None:
    os.truncate(path, 0)


def changed_by_another_program(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE meta SET value = '77' WHERE key = 'seal'")
    connection.close()


def copy_over(source: Path, path: Path) -> None:
    """As ``cp`` does: into the same file. By a process of its own: here, closing the file would drop SQLite's locks."""
    assert run('import shutil, sys; shutil.copyfile(sys.argv[1], sys.argv[2])', source, path).returncode == 0


TAKEN = [
    removed,
    removed_alone,
    moved_away,
    without_its_folder,
    replaced_by_another,
    replaced_by_an_older_copy,
    replaced_by_a_folder,
    replaced_by_a_link,
    overwritten_by_another,
    overwritten_by_an_older_copy,
    overwritten_by_the_copy_before_the_last_session,
    truncated,
    emptied,
    changed_by_another_program,
]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[SessionMap]:
    """A map with two ended sessions, the second of this process, and a running one that was saved and goes on."""
    path = tmp_path / 'maps' / 'a.map'
    path.parent.mkdir()
    make_map(path, 1.0)
    shutil.copy(path, tmp_path / 'older.map')
    session_map = open_map(path)
    drive(session_map, 0.8, 100.0)
    session_map.end_session()
    copy_over(path, tmp_path / 'before.map')
    drive(session_map, 0.6, 15.0)
    session_map.save()
    session_map.merge(scan(77, 0.1), Pose(500.0, 0.0))
    yield session_map
    session_map.close()


def held(session_map: SessionMap) -> StoredMap:
    """What the map holds in memory, the running session as an interrupted one."""
    rescued = session_map.rescue()
    assert rescued is not None
    content = read_map(rescued)
    rescued.unlink()
    assert_tables_equal(content.places, session_map.places())
    return content


def files_of(folder: Path) -> dict[str, str]:
    """The files in a folder, without those of SQLite and the lock."""
    files = folder_state(folder) if folder.is_dir() else {}
    return {name: digest for name, digest in files.items() if not name.endswith(('-wal', '-shm', '.lock'))}


@pytest.mark.parametrize('take', TAKEN)
@pytest.mark.parametrize('call', ['end_session', 'save', 'undo_session', 'clear', 'require_file', 'start_session'])
def test_nothing_succeeds_without_the_file(opened: SessionMap, take: Callable[[Path], None], call: str) -> None:
    path = Path(opened.config.path)
    arguments: tuple[object, ...] = ()
    if call == 'start_session':
        opened.end_session()
        arguments = ('next', 1)
    content = held(opened)
    take(path)
    there = files_of(path.parent)
    for _ in range(2):
        with pytest.raises(MapError) as refused:
            getattr(opened, call)(*arguments)
        assert str(path) in str(refused.value) and '\n' not in str(refused.value)
        assert 'nothing was written; the map is kept in memory: ' in str(refused.value)
        assert files_of(path.parent) == there
        assert difference(held(opened), content) == ''
    opened.close()
    # SQLite moves what the other program has committed into the file.
    assert files_of(path.parent) == there or take is changed_by_another_program


@pytest.mark.parametrize('take', [removed, removed_alone, moved_away])
def test_a_map_that_was_removed_is_written_again_when_that_is_asked_for(
    opened: SessionMap, take: Callable[[Path], None]
) -> None:
    path = Path(opened.config.path)
    content = held(opened)
    take(path)
    opened.save(again=True)
    assert sessions_of(path) == [(1, 'ended'), (2, 'ended'), (3, 'running')]
    assert_tables_equal(read_map(path).places, content.places)
    report = opened.end_session()
    assert report.session_id == 3
    opened.close()
    assert sessions_of(path) == [(1, 'ended'), (2, 'ended'), (3, 'ended')]
    with open_map(path) as session_map:
        assert [session_map.undo_session().session_id for _ in range(3)] == [3, 2, 1]
        assert len(session_map) == 0


@pytest.mark.parametrize('take', [replaced_by_another, replaced_by_an_older_copy, replaced_by_a_folder])
def test_what_is_in_the_place_of_the_map_is_never_overwritten(
    opened: SessionMap, take: Callable[[Path], None], tmp_path: Path
) -> None:
    path = Path(opened.config.path)
    content = held(opened)
    take(path)
    there = files_of(path.parent)
    with pytest.raises(MapError, match='move that file away and save'):
        opened.save(again=True)
    assert files_of(path.parent) == there
    path.rename(tmp_path / 'aside')
    opened.save(again=True)
    assert_tables_equal(read_map(path).places, content.places)


def test_a_file_that_is_put_back_is_used_again(opened: SessionMap) -> None:
    path = Path(opened.config.path)
    path.rename(path.with_name('elsewhere'))
    with pytest.raises(MapError, match='was removed'):
        opened.end_session()
    path.with_name('elsewhere').rename(path)
    opened.end_session()
    opened.close()
    assert sessions_of(path)[-1] == (3, 'ended')
    assert_tables_equal(read_map(path).places, opened.places())


def test_a_file_that_was_only_touched_is_used_again(opened: SessionMap) -> None:
    path = Path(opened.config.path)
    os.utime(path, ns=(1, 1))
    opened.end_session()
    assert sessions_of(path)[-1] == (3, 'ended')


def test_the_same_rows_on_other_pages_are_taken_for_what_they_are(opened: SessionMap) -> None:
    """SQLite remembers pages of the file that was overwritten."""
    path = Path(opened.config.path)
    opened.undo_session()
    for start_m in range(200, 3000, 30):
        drive(opened, 1.0, float(start_m))
        opened.end_session()
    opened.undo_session()
    drive(opened, 0.5)
    opened.save()
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute('VACUUM INTO ?', [str(path.with_name('vacuumed'))])
        connection.execute('SELECT * FROM places').fetchall()
    make_wal = run(
        'import sqlite3, sys; sqlite3.connect(sys.argv[1]).execute("PRAGMA journal_mode = WAL")',
        path.with_name('vacuumed'),
    )
    assert make_wal.returncode == 0
    copy_over(path.with_name('vacuumed'), path)
    opened.end_session()
    opened.close()
    assert_tables_equal(read_map(path).places, opened.places())


@pytest.mark.parametrize('suffixes', [['-wal'], ['-shm'], ['-wal', '-shm'], ['.lock'], ['-wal', '-shm', '.lock']])
def test_files_beside_the_map_are_not_needed(opened: SessionMap, suffixes: list[str]) -> None:
    path = Path(opened.config.path)
    for suffix in suffixes:
        path.with_name(path.name + suffix).unlink()
    opened.end_session()
    # Another process sees what was committed, and a copy of the file alone has it.
    assert run(
        'import sys; from small_maps import *; print(sessions_of(Path(sys.argv[1])))', path
    ).stdout.strip() == str([(1, 'ended'), (2, 'ended'), (3, 'ended')])
    copy_over(path, path.with_name('copy'))
    assert sessions_of(path.with_name('copy'))[-1] == (3, 'ended')
    opened.close()
    assert_tables_equal(read_map(path).places, opened.places())


SECOND_WRITER = """
    import sys
    from small_maps import *
    try:
        add_session(Path(sys.argv[1]), 0.05, 900.0)
    except Exception as error:
        print(type(error).__name__, error)
"""


def test_a_second_writer_is_refused_though_the_lock_file_was_removed(opened: SessionMap) -> None:
    path = Path(opened.config.path)
    for _ in range(2):
        path.with_name('a.map.lock').unlink(missing_ok=True)
        assert 'MapError' in (said := run(SECOND_WRITER, path).stdout) and 'in use by another process' in said
        with pytest.raises(MapError, match='in use by another process'):
            open_map(path)
    opened.end_session()
    assert path.with_name('a.map.lock').exists()
    opened.close()
    assert sessions_of(path) == [(1, 'ended'), (2, 'ended'), (3, 'ended')]
    assert not path.with_name('a.map.lock').exists()
    assert run(SECOND_WRITER, path).stdout == ''
    assert len(sessions_of(path)) == 4


def test_a_second_writer_of_a_new_map_at_the_path_keeps_its_map_and_lock(opened: SessionMap) -> None:
    path = Path(opened.config.path)
    content = held(opened)
    removed(path)
    with open_map(path) as second:
        second.adopt_model(MODEL)
        drive(second, 0.9)
        with pytest.raises(MapError, match='another file is in the place of the map'):
            opened.end_session()
        with pytest.raises(MapError, match='another file is in the place of the map'):
            opened.save(again=True)
        assert difference(held(opened), content) == ''
        opened.close()
        assert path.with_name('a.map.lock').exists()
        second.end_session()
    assert sessions_of(path) == [(1, 'ended')]


def test_a_writer_that_did_not_keep_the_locks_is_noticed(opened: SessionMap) -> None:
    """As on a file system without locks."""
    path = Path(opened.config.path)
    content = held(opened)
    path.with_name('a.map.lock').unlink()
    no_lock = 'import fcntl; fcntl.flock = lambda *_: None\n'
    assert run(no_lock + textwrap.dedent(SECOND_WRITER), path).stdout == ''
    others = sessions_of(path)
    with pytest.raises(MapError, match='another program has written the map file'):
        opened.end_session()
    assert sessions_of(path) == others
    assert difference(held(opened), content) == ''


def test_the_whole_map_is_rescued_beside_the_place_of_its_file(opened: SessionMap) -> None:
    path = Path(opened.config.path)
    removed(path)
    rescued = opened.rescue()
    assert rescued is not None and rescued.parent == path.parent
    assert rescued.name.startswith('a.map.rescued-') and rescued.suffix == '.db'
    assert sessions_of(rescued) == [(1, 'ended'), (2, 'ended'), (3, 'interrupted')]
    with open_map(rescued) as session_map:
        assert_tables_equal(session_map.places(), opened.places())
        assert (session_map.model, session_map.origin) == (opened.model, opened.origin)
        assert [session_map.undo_session().session_id for _ in range(3)] == [3, 2, 1]


def test_a_map_whose_folder_is_gone_is_rescued_elsewhere(
    opened: SessionMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_its_folder(Path(opened.config.path))
    monkeypatch.chdir(tmp_path)
    rescued = opened.rescue()
    assert rescued is not None and rescued.parent == tmp_path
    assert len(sessions_of(rescued)) == 3
    monkeypatch.setattr('offradar_ros.mapping.store.write_map', refuse)
    with pytest.raises(MapError, match='could not be written anywhere: no space'):
        opened.rescue()


def refuse(*_: object) -> NoReturn:
    raise MapError('no space')


ON_A_FULL_DISK = """
    import resource, sys
    from small_maps import *
    from offradar_ros.errors import MapError
    path, call = Path(sys.argv[1]), sys.argv[2]
    session_map = open_map(path)
    for lane in range(20):
        drive(session_map, 0.5, 100.0 * lane)
        if lane < 19:
            session_map.undo_session()
    for metre in range(3000):
        session_map.merge(scan(metre, 0.4), Pose(1000.0, 6.0 * metre))
    session_map.save()
    before = read_map(path)
    for metre in range(3000):
        session_map.merge(scan(3000 + metre, 0.4), Pose(2000.0, 6.0 * metre))
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size // 2, resource.RLIM_INFINITY))
    try:
        getattr(session_map, call)()
        print('succeeded')
    except MapError as error:
        print(error)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert difference(read_map(path), before) == ''
    assert not list(path.parent.glob('*.bak')) and not list(path.parent.glob('.offradar*'))
    session_map.end_session()
    assert_tables_equal(read_map(path).committed(), session_map.places())
    session_map.close()
"""


@pytest.mark.parametrize('call', ['end_session', 'save', 'clear', 'rescue'])
def test_a_full_disk_is_an_error_and_nothing_is_lost(tmp_path: Path, call: str) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    ended = run(ON_A_FULL_DISK, path, call)
    assert ended.returncode == 0, ended.stderr
    (line,) = ended.stdout.splitlines()
    assert str(path) in line and ('could not be' in line or 'cannot be written' in line)


def test_a_copy_of_the_file_alone_is_complete_after_each_write(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'copy.map'
    with open_map(path) as session_map:
        session_map.adopt_model(MODEL)

        def assert_copied() -> None:
            copy_over(path, copy)
            assert session_map.is_file_complete
            assert difference(read_map(copy), read_map(path)) == ''
            assert_tables_equal(read_map(copy).places, session_map.places())

        drive(session_map, 1.0)
        session_map.save()
        assert_copied()
        session_map.end_session()
        assert_copied()
        drive(session_map, 0.5)
        session_map.end_session()
        assert_copied()
        session_map.undo_session()
        assert_copied()
        session_map.clear()
        assert_copied()


def test_a_reader_delays_the_copy_and_nothing_else(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'copy.map'
    make_map(path, 1.0)
    with open_map(path) as session_map:
        drive(session_map, 0.7)
        session_map.save()
        reader = subprocess.Popen(
            [sys.executable, '-c', READER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        with reader:
            assert reader.stdin is not None and reader.stdout is not None
            assert reader.stdout.readline().strip() == '6'
            session_map.end_session()
            assert not session_map.is_file_complete
            assert_tables_equal(read_map(path).committed(), session_map.places())
            # The file alone is an earlier state, and sound.
            copy_over(path, copy)
            assert sessions_of(copy) == [(1, 'ended'), (2, 'running')]
            drive(session_map, 0.6, 50.0)
            session_map.end_session()
            back_up(path, tmp_path / 'backup.map')
            assert sessions_of(tmp_path / 'backup.map') == [(1, 'ended'), (2, 'ended'), (3, 'ended')]
            reader.communicate('end')
        session_map.adopt_model(MODEL)
        drive(session_map, 0.5)
        session_map.end_session()
        assert session_map.is_file_complete
    copy_over(path, copy)
    assert [state for _, state in sessions_of(copy)] == ['ended'] * 4


READER = """
import sqlite3, sys
connection = sqlite3.connect(f'file:{sys.argv[1]}?mode=ro', uri=True, isolation_level=None)
connection.execute('BEGIN')
print(connection.execute('SELECT count(*) FROM places').fetchone()[0], flush=True)
sys.stdin.read()
"""


def test_a_killed_writer_behind_a_reader_loses_nothing(tmp_path: Path) -> None:
    """What was committed is in the log alone, over several transactions."""
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    code = """
        import subprocess
        import sys
        from small_maps import *
        session_map = open_map(Path(sys.argv[1]))
        drive(session_map, 0.7)
        session_map.save()
        reader = subprocess.Popen([sys.executable, '-c', sys.argv[2], sys.argv[1]], stdin=-1, stdout=-1, text=True)
        reader.stdout.readline()
        session_map.end_session()
        for start_m in (50.0, 100.0):
            drive(session_map, 0.6, start_m)
            session_map.end_session()
        assert not session_map.is_file_complete
        reader.kill()
        reader.wait()
        die()
    """
    killed(code, path, READER)
    assert log_of(path).stat().st_size
    assert [state for _, state in sessions_of(path)] == ['ended'] * 4
    add_session(path, 0.5)
    assert [state for _, state in sessions_of(path)] == ['ended'] * 5


def test_a_file_that_is_removed_during_the_write_is_an_error(
    opened: SessionMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path(opened.config.path)
    put = SealedRows.put_session

    def remove_and_put(rows: SealedRows, session: StoredSession) -> None:
        path.unlink()
        put(rows, session)

    with monkeypatch.context() as patch:
        patch.setattr(SealedRows, 'put_session', remove_and_put)
        with pytest.raises(MapError, match='was removed'):
            opened.end_session()
    assert opened.running_session_id == 3
    opened.save(again=True)
    opened.end_session()
    assert sessions_of(path) == [(1, 'ended'), (2, 'ended'), (3, 'ended')]
    assert_tables_equal(read_map(path).places, opened.places())


def test_another_writer_is_noticed_though_the_times_of_the_file_do_not_tell(
    opened: SessionMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path(opened.config.path)
    path.with_name('a.map.lock').unlink()
    no_lock = 'import fcntl; fcntl.flock = lambda *_: None\n'
    assert run(no_lock + textwrap.dedent(SECOND_WRITER), path).stdout == ''
    others = sessions_of(path)
    monkeypatch.setattr(HeldFile, 'is_changed', lambda _: False)
    with pytest.raises(MapError, match='another program has written the map file'):
        opened.end_session()
    assert sessions_of(path) == others


class CutOff:
    """A connection that is interrupted after it has committed."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self.in_transaction = False

    def execute(self, statement: str, *values: Any) -> Any:
        done = self._connection.execute(statement, *values)
        if statement == 'COMMIT':
            raise KeyboardInterrupt
        return done

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


def test_a_commit_whose_outcome_is_not_known_is_done_again(opened: SessionMap) -> None:
    store = opened._store
    assert store is not None and store._connection is not None
    connection = store._connection
    store._connection = CutOff(connection)  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        opened.end_session()
    store._connection = connection
    opened.end_session()
    assert sessions_of(Path(opened.config.path))[-1] == (3, 'ended')


def test_a_log_that_was_removed_behind_a_reader_takes_nothing_with_it(tmp_path: Path) -> None:
    """The reader keeps the commit from being moved into the file, and nobody else could find the log."""
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    code = """
        import subprocess
        import sys
        from small_maps import *
        path = Path(sys.argv[1])
        session_map = open_map(path)
        drive(session_map, 0.7)
        session_map.save()
        reader = subprocess.Popen([sys.executable, '-c', sys.argv[2], sys.argv[1]], stdin=-1, stdout=-1, text=True)
        reader.stdout.readline()
        for suffix in ('-wal', '-shm'):
            path.with_name(path.name + suffix).unlink()
        session_map.end_session()
        reader.kill()
        reader.wait()
        die()
    """
    killed(code, path, READER)
    assert sessions_of(path) == [(1, 'ended'), (2, 'ended')]


def test_a_refused_second_writer_of_the_same_process_does_not_release_the_locks_of_the_first(
    opened: SessionMap,
) -> None:
    """A process that closes a file loses all its locks on it, SQLite's among them."""
    path = Path(opened.config.path)
    code = """
        import fcntl, sys
        with open(sys.argv[1], 'r+b') as file:
            # The bytes that SQLite locks to share a file.
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 510, 0x40000002)
    """
    assert 'BlockingIOError' in run(code, path).stderr
    path.with_name('a.map.lock').unlink()
    with pytest.raises(MapError, match='in use by another process'):
        open_map(path)
    assert 'BlockingIOError' in run(code, path).stderr
