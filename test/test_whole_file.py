"""A file is written whole or not at all, and nothing else is touched."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from unprivileged import obey_permissions

from offradar_ros.whole_file import whole_file, write_whole_file


def test_the_content_is_replaced_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    write_whole_file(tmp_path / 'a', b'1')
    write_whole_file(tmp_path / 'a', b'2')
    assert (tmp_path / 'a').read_bytes() == b'2'
    assert [path.name for path in tmp_path.iterdir()] == ['a']


def test_a_block_that_raises_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / 'a'
    path.write_bytes(b'old')
    with pytest.raises(KeyboardInterrupt), whole_file(path) as file:
        file.write(b'half')
        raise KeyboardInterrupt
    assert path.read_bytes() == b'old'
    with pytest.raises(ZeroDivisionError), whole_file(tmp_path / 'new'):
        raise ZeroDivisionError
    assert [found.name for found in tmp_path.iterdir()] == ['a']


def test_a_block_that_raises_after_somebody_removed_the_draft_says_what_it_raised(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), whole_file(tmp_path / 'a'):
        next(tmp_path.iterdir()).unlink()
        raise ZeroDivisionError


def test_the_content_is_on_the_disk_before_it_has_its_name_and_the_name_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, synced = tmp_path / 'a', list[object]()

    def fsync(descriptor: int) -> None:
        what = Path(f'/proc/self/fd/{descriptor}').resolve()
        synced.append(list(what.iterdir()) if what.is_dir() else (what.read_bytes(), path.exists()))

    monkeypatch.setattr(os, 'fsync', fsync)
    write_whole_file(path, b'new')
    assert synced == [(b'new', False), [path]]


@pytest.mark.parametrize(
    ('number', 'is_written'), [(errno.EINVAL, True), (errno.ENOTSUP, True), (errno.EIO, False), (errno.ENOSPC, False)]
)
def test_a_file_system_that_cannot_sync_a_folder_is_used_and_a_fault_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, is_written: bool
) -> None:
    def fsync(descriptor: int) -> None:
        if Path(f'/proc/self/fd/{descriptor}').is_dir():
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, 'fsync', fsync)
    if is_written:
        write_whole_file(tmp_path / 'a', b'1')
    else:
        with pytest.raises(OSError, match=os.strerror(number)):
            write_whole_file(tmp_path / 'a', b'1')
    assert (tmp_path / 'a').read_bytes() == b'1'


def test_a_link_that_has_the_name_of_the_draft_is_not_written_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('offradar_ros.whole_file.secrets.token_hex', lambda count: '0' * 2 * count)
    (tmp_path / 'other').write_bytes(b'of somebody else')
    with whole_file(tmp_path / 'a'):
        (draft,) = (path for path in tmp_path.iterdir() if path.name != 'other')
    draft.symlink_to(tmp_path / 'other')
    with pytest.raises(FileExistsError):
        write_whole_file(tmp_path / 'a', b'ours')
    assert (tmp_path / 'other').read_bytes() == b'of somebody else'


_ON_A_FULL_DISK = """
import resource, sys
from offradar_ros.whole_file import write_whole_file
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    write_whole_file(sys.argv[1], b'x' * int(sys.argv[2]))
except OSError as error:
    print(error.strerror)
"""


@pytest.mark.parametrize(('size', 'content', 'said'), [(100_000, b'old', 'File too large'), (10, b'x' * 10, '')])
def test_a_full_disk_leaves_the_file_as_it_was(tmp_path: Path, size: int, content: bytes, said: str) -> None:
    path = tmp_path / 'a'
    path.write_bytes(b'old')
    command = [sys.executable, '-c', _ON_A_FULL_DISK, str(path), str(size)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == said
    assert path.read_bytes() == content
    assert [found.name for found in tmp_path.iterdir()] == ['a']


def test_a_file_keeps_its_permissions_and_a_new_one_follows_the_umask(tmp_path: Path) -> None:
    path = tmp_path / 'a'
    before = os.umask(0o027)
    try:
        write_whole_file(path, b'1')
        assert path.stat().st_mode & 0o777 == 0o640
        path.chmod(0o604)
        write_whole_file(path, b'2')
        assert path.stat().st_mode & 0o777 == 0o604
    finally:
        os.umask(before)


def test_a_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    path = tmp_path / 'link'
    (tmp_path / 'other').write_bytes(b'of somebody else')
    path.symlink_to(tmp_path / 'other')
    (tmp_path / 'other').chmod(0o600)
    (tmp_path / 'new').touch()
    write_whole_file(path, b'ours')
    assert not path.is_symlink()
    assert path.stat().st_mode == (tmp_path / 'new').stat().st_mode
    assert path.read_bytes() == b'ours'
    assert (tmp_path / 'other').read_bytes() == b'of somebody else'


def test_devices_folders_and_pipes_are_never_replaced(tmp_path: Path) -> None:
    (tmp_path / 'folder').mkdir()
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'null').symlink_to('/dev/null')
    for name in ('folder', 'pipe', 'null'):
        with pytest.raises(OSError, match=r'directory|regular') as caught:
            write_whole_file(tmp_path / name, b'1')
        assert caught.value.strerror
    assert sorted(path.name for path in tmp_path.iterdir()) == ['folder', 'null', 'pipe']


def test_a_folder_is_called_one(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        write_whole_file(tmp_path, b'1')


def test_a_file_that_nobody_may_read_is_replaced(tmp_path: Path) -> None:
    (tmp_path / 'a').write_bytes(b'\x89PNG')
    (tmp_path / 'a').chmod(0o200)
    program = 'import sys; from offradar_ros.whole_file import write_whole_file; write_whole_file(sys.argv[1], b"text")'
    command = [sys.executable, '-c', program, str(tmp_path / 'a')]
    subprocess.run(command, preexec_fn=obey_permissions, timeout=60, check=True)
    (tmp_path / 'a').chmod(0o600)
    assert (tmp_path / 'a').read_bytes() == b'text'


def test_a_name_as_long_as_the_file_system_allows(tmp_path: Path) -> None:
    path = tmp_path / ('a' * 255)
    write_whole_file(path, b'1')
    assert path.read_bytes() == b'1'
    with pytest.raises(OSError, match='too long'):
        write_whole_file(tmp_path / ('a' * 256), b'1')
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ('there', 'written'),
    [
        (b'SQLite format 3\0 and pages', b'a,b\n1,2\n'),
        (b'\x89MCAP0\r\n', b'\x08\x07\x12\x00'),
        (b'SQLite format 3\0', b'\x10\0\0\0\0\0\0\0{}'),
        (b'#ROSBAG V2.0\n', b'a,b\n'),
        (b'\x10\0\0\0\0\0\0\0{}', b'a: 1\n'),
        (b'a: 1\n', b'\x89PNG\r\n\x1a\n'),
    ],
)
def test_a_file_of_another_kind_stays(tmp_path: Path, there: bytes, written: bytes) -> None:
    (tmp_path / 'a').write_bytes(there)
    with pytest.raises(OSError, match='give another name'):
        write_whole_file(tmp_path / 'a', written)
    assert (tmp_path / 'a').read_bytes() == there
    assert [found.name for found in tmp_path.iterdir()] == ['a']


def test_a_file_of_the_same_kind_and_an_empty_one_are_replaced(tmp_path: Path) -> None:
    # The start that is looked at ends within a character.
    for there, written in ((b'', b'\x89PNG'), (b'a' * 4095 + 'ü'.encode(), b'b'), (b'\0\1', b'\2\0')):
        (tmp_path / 'a').write_bytes(there)
        write_whole_file(tmp_path / 'a', written)
        assert (tmp_path / 'a').read_bytes() == written
