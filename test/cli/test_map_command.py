"""`offradar map`: what a file holds, and a copy of it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from small_maps import as_version_1, as_version_2, difference, drive, leave_a_log, make_map, open_map, run, sessions_of

from offradar_ros.mapping.map_reader import read_map


def test_a_map_is_backed_up_while_it_is_written(
    done: Callable[..., str], refused: Callable[..., str], tmp_path: Path
) -> None:
    path, copy = tmp_path / 'town.db', tmp_path / 'backup.db'
    make_map(path, 1.0)
    with open_map(path) as session_map:
        drive(session_map, 0.5)
        session_map.end_session()
        assert done('map', path, '--backup', copy) == f'{copy}: the map as of the last save, written and read again\n'
        assert difference(read_map(copy), read_map(path)) == ''
        session_map.undo_session()
        assert 'is there already and is not overwritten: --overwrite replaces it' in refused(
            'map', path, '--backup', copy
        )
        assert sessions_of(copy) == [(1, 'ended'), (2, 'ended')]
        done('map', path, '--backup', copy, '--overwrite')
        assert sessions_of(copy) == [(1, 'ended'), (2, 'undone')]
    assert 'is the map itself' in refused('map', path, '--backup', path, '--overwrite')
    assert 'give --backup FILE' in refused('map', path, '--overwrite')


def test_a_foreign_log_is_told_of(done: Callable[..., str], tmp_path: Path) -> None:
    path, other = tmp_path / 'town.db', tmp_path / 'other.db'
    make_map(path, 1.0)
    make_map(other, 0.9, 0.7)
    leave_a_log(path, 0.5)
    shutil.copy(other, path)
    shown = done('map', path)
    assert 'note: town.db-wal beside it belongs to another file, or another state of it: it was not read' in shown
    assert len(sessions_of(path)) == 2


@pytest.mark.parametrize('rewrite', [as_version_1, as_version_2])
def test_a_map_of_an_old_version_is_shown(
    done: Callable[..., str], tmp_path: Path, rewrite: Callable[[Path], None]
) -> None:
    make_map(tmp_path / 'town.db', 1.0)
    shown = done('map', tmp_path / 'town.db').splitlines()
    rewrite(tmp_path / 'town.db')
    older = done('map', tmp_path / 'town.db').splitlines()
    (of_this,), (of_older,) = set(shown) - set(older), set(older) - set(shown)
    assert of_this.startswith('signatures: ') and of_older == 'signatures: 0 of 6 places, 0.0 kB with undo'


def test_the_signatures_of_places_are_counted(done: Callable[..., str], tmp_path: Path) -> None:
    path = tmp_path / 'town.db'
    make_map(path, 1.0, 0.5)
    stored = read_map(path)
    of_places = [
        scan
        for scan in stored.signatures
        if ((stored.places.session_ids == scan.session_id) & (stored.places.stamps_ns == scan.stamp_ns)).any()
    ]
    assert 0 < len(of_places) < len(stored.signatures)
    kilobytes = sum(len(content) for content in stored.signatures.values()) / 1000.0
    assert f'signatures: {len(of_places)} of 6 places, {kilobytes:.1f} kB with undo\n' in done('map', path)


def test_what_is_not_a_file_is_refused_at_once(refused: Callable[..., str], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'fifo')
    (tmp_path / 'loop').symlink_to('loop')
    for name in ('fifo', '.', 'loop', 'x' * 300, '/dev/zero'):
        assert str(tmp_path / name) in refused('map', tmp_path / name)
        assert refused('map', tmp_path / name, '--backup', tmp_path / 'copy')
    assert not (tmp_path / 'copy').exists()


@pytest.mark.parametrize('arguments', [[], ['--backup', '/tmp/never']])
def test_a_folder_that_may_not_be_entered_is_one_line(tmp_path: Path, arguments: list[str]) -> None:
    code = """
        import os, sys
        from offradar_ros.cli.main import main
        locked, sound = sys.argv[1:3]
        arguments = sys.argv[3:]
        # All that a command imports is imported while that is allowed.
        sys.argv[:] = ['offradar', 'map', sound]
        try:
            main()
        except SystemExit:
            pass
        os.chdir('/')
        if os.getuid() == 0:
            os.setuid(65534)
        sys.argv[:] = ['offradar', 'map', locked + '/town.db', *arguments]
        sys.exit(main())
    """
    locked = tmp_path / 'locked'
    locked.mkdir(0o000)
    make_map(tmp_path / 'sound.db', 1.0)
    ended = run(code, locked, tmp_path / 'sound.db', *arguments)
    locked.chmod(0o700)
    assert ended.returncode == 1
    assert 'Traceback' not in ended.stderr
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f'error: {locked}/town.db: cannot be read (Permission denied)')
