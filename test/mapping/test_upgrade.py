"""A map of an earlier version of the format is read as it is, and upgraded when it is opened to be written."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import pytest
from small_maps import (
    MODEL,
    add_session,
    as_version_1,
    as_version_2,
    as_version_3,
    assert_holds,
    assert_tables_equal,
    difference,
    drive,
    folder_state,
    make_map,
    open_map,
    run,
    signature_of,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping import schema
from offradar_ros.mapping.map_reader import read_committed, read_map
from offradar_ros.mapping.place_columns import PlaceColumns


def version_of(path: Path) -> int:
    with contextlib.closing(sqlite3.connect(path)) as connection:
        return int(connection.execute('PRAGMA user_version').fetchone()[0])


@pytest.fixture(params=[1, 2, 3])
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture
def old(tmp_path: Path, version: int) -> Path:
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.8)
    with open_map(path) as session_map:
        drive(session_map, 0.6, 40.0)
        session_map.save()
    {1: as_version_1, 2: as_version_2, 3: as_version_3}[version](path)
    return path


def test_it_is_read_without_a_change(old: Path, version: int) -> None:
    before = folder_state(old.parent)
    stored = read_map(old)
    assert [session.state for session in stored.sessions] == ['ended', 'ended', 'running']
    assert (stored.version, bool(stored.signatures), stored.seal is None) == (version, version == 3, version == 1)
    assert np.isnan(stored.places.yaw_sds_rad).all()
    assert np.isfinite(stored.places.yaws_rad).any()
    _, columns = read_committed(old, PlaceColumns)
    assert_tables_equal(columns.table, stored.committed())
    assert version_of(old) == version
    assert folder_state(old.parent) == before


def test_a_writer_upgrades_it_and_keeps_the_file_as_it_was(old: Path, version: int) -> None:
    content, file = read_map(old), old.read_bytes()
    old.chmod(0o640)
    with open_map(old) as session_map:
        (notice,) = session_map.notices
        kept = old.with_name(f'a.map.v{version}.bak')
        assert notice == f'{old}: upgraded from map format {version} to 4; the file as it was is kept as {kept.name}'
        assert_tables_equal(session_map.places(), content.places)
    assert kept.read_bytes() == file
    assert_holds(kept, content)
    assert_holds(old, content)
    assert version_of(old) == schema.VERSION == 4
    assert old.stat().st_mode & 0o777 == 0o640
    assert sorted(path.name for path in old.parent.iterdir()) == ['a.map', kept.name]
    with open_map(old) as session_map:
        assert session_map.notices == ()
        session_map.adopt_model(MODEL)
        assert [session_map.undo_session().session_id for _ in range(3)] == [3, 2, 1]
    assert kept.read_bytes() == file


def test_places_of_an_upgraded_map_gain_what_it_did_not_have(old: Path, version: int) -> None:
    add_session(old, 0.2)
    stored = read_map(old)
    assert np.isfinite(stored.places.yaw_sds_rad).any()
    assert stored.signatures
    with open_map(old) as session_map:
        session_map.undo_session()
        assert np.isnan(session_map.places().yaw_sds_rad).all()


def test_an_earlier_copy_is_not_replaced(old: Path, version: int) -> None:
    kept = old.with_name(f'a.map.v{version}.bak')
    kept.write_text('of another map')
    open_map(old).close()
    assert kept.read_text() == 'of another map'
    (other,) = old.parent.glob(f'a.map.v{version}.2*.bak')
    assert difference(read_map(other), read_map(old)) == ''


def test_an_upgrade_that_was_cut_off_is_done_again(old: Path, version: int) -> None:
    kept = old.with_name(f'a.map.v{version}.bak')
    os.link(old, kept)
    open_map(old).close()
    assert (version_of(old), version_of(kept)) == (schema.VERSION, version)
    assert len(list(old.parent.iterdir())) == 2


def test_an_upgrade_that_fails_leaves_the_map_as_it_was(
    old: Path, version: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = old.read_bytes()

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patch:
        patch.setattr('offradar_ros.mapping.whole_map._sync', fail)
        with pytest.raises(MapError, match=r'cannot be written there \(No space left'):
            open_map(old)
    assert old.read_bytes() == file
    assert {path.name for path in old.parent.iterdir()} <= {'a.map', f'a.map.v{version}.bak'}
    add_session(old, 0.5)
    assert version_of(old) == schema.VERSION


def test_without_hard_links_the_file_is_copied(old: Path, version: int, monkeypatch: pytest.MonkeyPatch) -> None:
    content, file = read_map(old), old.read_bytes()

    def refuse(*_: object) -> None:
        raise PermissionError(1, 'Operation not permitted')

    monkeypatch.setattr('os.link', refuse)
    open_map(old).close()
    assert old.with_name(f'a.map.v{version}.bak').read_bytes() == file
    assert_holds(old, content)


def test_a_damaged_one_is_not_upgraded(old: Path) -> None:
    with contextlib.closing(sqlite3.connect(old)) as connection, connection:
        connection.execute('UPDATE places SET uncertainty = -1.0')
    before = folder_state(old.parent)
    with pytest.raises(MapError, match='damaged'):
        open_map(old)
    assert folder_state(old.parent) == before


def test_a_file_that_may_only_be_read_is_read(old: Path, version: int) -> None:
    code = """
        import os, sys
        from small_maps import *
        from offradar_ros.errors import MapError
        path = Path(sys.argv[1])
        if os.getuid() == 0:
            os.setuid(65534)
        print(len(read_map(path).places))
        try:
            open_map(path)
        except MapError as error:
            print(error)
    """
    # Another user cannot enter the folders of pytest.
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'a.map'
        shutil.copy(old, path)
        path.chmod(0o444)
        path.parent.chmod(0o555)
        ended = run(code, path)
        path.parent.chmod(0o755)
        assert ended.returncode == 0, ended.stderr
        places, refused = ended.stdout.splitlines()
        assert int(places) == len(read_map(old).places)
        assert refused == f'{path}: the map cannot be written there (Permission denied)'
        assert version_of(path) == version


@pytest.mark.parametrize('version', [1, 2], indirect=True)
def test_it_gains_signatures_as_places_are_replaced(old: Path) -> None:
    add_session(old, 0.4)
    stored = read_map(old)
    session = max(session.session_id for session in stored.sessions)
    replaced = stored.places.stamps_ns[stored.places.session_ids == session].tolist()
    expected = {(session, stamp): signature_of(stamp, 0.4) for stamp in replaced if signature_of(stamp, 0.4)}
    assert stored.signatures == expected
    assert 0 < len(expected) < len(stored.places)
