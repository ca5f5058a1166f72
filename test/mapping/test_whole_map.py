"""A map is copied whole or not at all, while another process writes it."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import stat
from pathlib import Path

import pytest
from small_maps import (
    add_session,
    as_version_1,
    assert_holds,
    assert_tables_equal,
    change,
    difference,
    drive,
    folder_state,
    leave_a_log,
    make_map,
    open_map,
    run,
    sessions_of,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import check_map, log_of, read_map
from offradar_ros.mapping.whole_map import back_up, write_map


def test_a_copy_is_the_map(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'copies' / 'b.map'
    copy.parent.mkdir()
    make_map(path, 1.0, 0.5)
    before = folder_state(tmp_path)
    back_up(path, copy)
    assert_holds(copy, read_map(path))
    assert [file.name for file in copy.parent.iterdir()] == ['b.map']
    assert folder_state(tmp_path) == before
    add_session(copy, 0.25)
    assert len(sessions_of(copy)) == 3 and len(sessions_of(path)) == 2


def test_a_copy_holds_what_a_writer_has_saved(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    with open_map(path) as session_map:
        drive(session_map, 0.5)
        session_map.save()
        back_up(path, copy)
        assert sessions_of(copy) == [(1, 'ended'), (2, 'running')]
        session_map.end_session()
        back_up(path, copy, overwrite=True)
        assert sessions_of(copy) == [(1, 'ended'), (2, 'ended')]
        assert_tables_equal(read_map(copy).places, session_map.places())


def test_a_copy_holds_what_is_in_the_log_of_a_killed_writer(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    leave_a_log(path, 0.5)
    back_up(path, copy)
    assert sessions_of(copy) == [(1, 'ended'), (2, 'ended')]
    assert not log_of(copy).exists()


def test_a_copy_does_not_hold_what_is_in_a_foreign_log(tmp_path: Path) -> None:
    path, copy, other = tmp_path / 'a.map', tmp_path / 'b.map', tmp_path / 'other.map'
    make_map(path, 1.0)
    make_map(other, 0.7)
    leave_a_log(path, 0.5)
    shutil.copy(other, path)
    back_up(path, copy)
    assert difference(read_map(copy), read_map(other)) == ''


def test_a_map_of_the_old_version_is_copied_as_it_is(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    as_version_1(path)
    back_up(path, copy)
    assert difference(read_map(copy), read_map(path)) == ''
    assert read_map(copy).seal is None


def test_a_file_is_replaced_only_if_that_is_asked_for(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    copy.write_text('precious')
    copy.chmod(0o600)
    with pytest.raises(MapError, match='is there already and is not overwritten'):
        back_up(path, copy)
    assert copy.read_text() == 'precious'
    back_up(path, copy, overwrite=True)
    assert_holds(copy, read_map(path))
    assert stat.S_IMODE(copy.stat().st_mode) == 0o600


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    path, copy, target = tmp_path / 'a.map', tmp_path / 'b.map', tmp_path / 'target'
    make_map(path, 1.0)
    copy.symlink_to(target)
    with pytest.raises(MapError, match='is there already'):
        back_up(path, copy)
    target.write_text('of somebody else')
    back_up(path, copy, overwrite=True)
    assert not copy.is_symlink()
    assert target.read_text() == 'of somebody else'
    assert copy.stat().st_mode == path.stat().st_mode


def test_the_map_itself_is_no_copy_of_it(tmp_path: Path) -> None:
    path, link = tmp_path / 'a.map', tmp_path / 'link.map'
    make_map(path, 1.0)
    link.symlink_to(path)
    (tmp_path / 'hard.map').hardlink_to(path)
    (tmp_path / 'no').mkdir()
    before = folder_state(tmp_path)
    for copy in (path, link, tmp_path / 'hard.map', tmp_path / 'no' / '..' / 'a.map'):
        with pytest.raises(MapError, match='is the map itself'):
            back_up(path, copy, overwrite=True)
    assert folder_state(tmp_path) == before


def test_a_map_that_is_being_written_is_not_replaced_by_a_copy(tmp_path: Path) -> None:
    path, used = tmp_path / 'a.map', tmp_path / 'used.map'
    make_map(path, 1.0)
    with open_map(used), pytest.raises(MapError, match='in use by another process'):
        back_up(path, used, overwrite=True)


@pytest.mark.parametrize('overwrite', [False, True])
def test_a_log_beside_the_copy_is_not_applied_to_it(tmp_path: Path, overwrite: bool) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    make_map(copy, 0.9)
    leave_a_log(copy, 0.5)
    log = log_of(copy).read_bytes()
    if not overwrite:
        copy.unlink()
    back_up(path, copy, overwrite=overwrite)
    assert_holds(copy, read_map(path))
    (kept,) = tmp_path.glob('b.map-wal.stale-*')
    assert kept.read_bytes() == log


def test_what_a_log_without_content_leaves_beside_the_copy_is_removed(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    log_of(copy).touch()
    (tmp_path / 'b.map-shm').write_bytes(b'index of a log that is no more')
    back_up(path, copy)
    assert sorted(file.name for file in tmp_path.iterdir()) == ['a.map', 'b.map']


def test_a_rollback_log_beside_the_copy_is_kept_under_another_name(tmp_path: Path) -> None:
    make_map(tmp_path / 'a.map', 1.0)
    (tmp_path / 'b.map-journal').write_bytes(b'of another file')
    back_up(tmp_path / 'a.map', tmp_path / 'b.map')
    (kept,) = tmp_path.glob('b.map-journal*')
    assert kept.name.startswith('b.map-journal.stale-')
    assert kept.read_bytes() == b'of another file'


def test_a_log_that_cannot_be_renamed_is_never_beside_the_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    log_of(copy).write_bytes(b'of another map')

    def refuse(*_: object) -> None:
        raise PermissionError(1, 'Operation not permitted')

    monkeypatch.setattr(Path, 'rename', refuse)
    with pytest.raises(
        MapError, match=r'b\.map-wal: does not belong to the map .*\(Operation not permitted\): move it'
    ):
        back_up(path, copy)
    assert sorted(file.name for file in tmp_path.iterdir()) == ['a.map', 'b.map-wal']


def test_a_copy_is_on_the_disk_before_it_has_its_name_and_the_name_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    stored, synced = read_map(path), list[tuple[bool, bool]]()

    def fsync(descriptor: int) -> None:
        synced.append((Path(f'/proc/self/fd/{descriptor}').is_dir(), copy.exists()))

    monkeypatch.setattr(os, 'fsync', fsync)
    for write in (lambda: back_up(path, copy), lambda: write_map(copy, stored)):
        synced.clear()
        write()
        assert synced == [(False, False), (True, True)]
        copy.unlink()


def test_nobody_else_may_enter_the_folder_of_a_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, modes = tmp_path / 'a.map', list[int]()
    make_map(path, 1.0)
    link = os.link

    def seen(draft: Path, copy: Path) -> None:
        modes.append(stat.S_IMODE(draft.parent.stat().st_mode))
        link(draft, copy)

    monkeypatch.setattr(os, 'link', seen)
    back_up(path, tmp_path / 'b.map')
    assert modes == [0o700]


def test_a_damaged_map_is_not_copied(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    change(path, 'UPDATE places SET uncertainty = 2.0')
    with pytest.raises(MapError, match='rows of places are not as written') as refused:
        back_up(path, copy)
    assert str(refused.value).startswith(f'{path}: the map is damaged (')
    assert [file.name for file in tmp_path.iterdir()] == ['a.map']


def test_a_copy_that_is_not_what_was_read_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    stored = read_map(path)
    make_map(tmp_path / 'other.map', 0.5)
    wrong = (read_map(tmp_path / 'other.map').seal, False)
    monkeypatch.setattr('offradar_ros.mapping.whole_map.check_map', lambda _: wrong)
    with pytest.raises(MapError, match='is not what was read'):
        back_up(path, copy)
    with pytest.raises(MapError, match='is not what was read'):
        write_map(copy, stored)
    with open_map(path) as session_map:
        with pytest.raises(MapError, match=r'is not what was read.*so it was not cleared'):
            session_map.clear()
        assert len(session_map) == 6
    assert_holds(path, stored)
    assert sorted(file.name for file in tmp_path.iterdir()) == ['a.map', 'other.map']


def test_a_copy_that_is_damaged_is_named_and_not_the_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)

    def damaged(draft: Path) -> object:
        if draft != path:
            change(draft, 'UPDATE places SET uncertainty = 2.0')
        return check_map(draft)

    monkeypatch.setattr('offradar_ros.mapping.whole_map.check_map', damaged)
    for write in (lambda: back_up(path, copy), lambda: write_map(copy, read_map(path))):
        with pytest.raises(MapError, match='rows of places are not as written') as refused:
            write()
        assert str(refused.value).startswith(f'{copy}: what was written there cannot be read (the map is damaged (')
    assert [file.name for file in tmp_path.iterdir()] == ['a.map']


def test_a_full_disk_leaves_no_copy(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0, 0.5)
    copy.write_text('precious')
    code = """
        import resource, sys
        from small_maps import *
        from offradar_ros.errors import MapError
        from offradar_ros.mapping.whole_map import back_up
        resource.setrlimit(resource.RLIMIT_FSIZE, (10000, 10000))
        try:
            back_up(Path(sys.argv[1]), Path(sys.argv[2]), overwrite=True)
        except MapError as error:
            print(error)
    """
    said = run(code, path, copy).stdout
    assert said.startswith(f'{copy}: a map cannot be written there (')
    assert copy.read_text() == 'precious'
    assert sorted(file.name for file in tmp_path.iterdir()) == ['a.map', 'b.map']


def test_without_hard_links_a_copy_is_renamed_and_replaces_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)

    def refuse(*_: object) -> None:
        raise PermissionError(1, 'Operation not permitted')

    monkeypatch.setattr('os.link', refuse)
    back_up(path, copy)
    assert_holds(copy, read_map(path))

    def appear(*_: object) -> None:
        (tmp_path / 'c.map').write_text('precious')
        refuse()

    monkeypatch.setattr('os.link', appear)
    with pytest.raises(MapError, match='is there already'):
        back_up(path, tmp_path / 'c.map')
    assert (tmp_path / 'c.map').read_text() == 'precious'


def test_a_file_that_appears_while_a_copy_is_written_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    monkeypatch.setattr('offradar_ros.mapping.whole_map._sync', lambda _: copy.write_text('precious'))
    with pytest.raises(MapError, match='is there already'):
        back_up(path, copy)
    assert copy.read_text() == 'precious'


def test_a_new_map_does_not_follow_a_link_that_was_put_in_its_way(tmp_path: Path) -> None:
    """No name that anybody can know before is written to."""
    target = tmp_path / 'target'
    target.write_text('of somebody else')
    for name in ('a.map.new', 'a.map-wal', 'a.map-journal', 'a.map.v1.bak'):
        (tmp_path / name).symlink_to(target)
    make_map(tmp_path / 'a.map', 1.0)
    assert target.read_text() == 'of somebody else'
    assert len(read_map(tmp_path / 'a.map').places) == 6


def test_nothing_is_left_of_a_copy_that_fails(tmp_path: Path) -> None:
    make_map(tmp_path / 'a.map', 1.0)
    with pytest.raises(MapError, match='cannot be written there'):
        back_up(tmp_path / 'a.map', tmp_path / 'no folder' / 'b.map')
    with pytest.raises(MapError, match='no map file there'):
        back_up(tmp_path / 'nothing.map', tmp_path / 'b.map')
    with contextlib.closing(sqlite3.connect(tmp_path / 'diary.db')) as connection:
        connection.execute('CREATE TABLE diary (day)')
    with pytest.raises(MapError, match='not a map'):
        back_up(tmp_path / 'diary.db', tmp_path / 'b.map')
    assert sorted(file.name for file in tmp_path.iterdir()) == ['a.map', 'diary.db']
