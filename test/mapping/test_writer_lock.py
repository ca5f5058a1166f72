"""One writer for each map; a check whether there is one does not block a writer."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from offradar_ros.errors import MapError
from offradar_ros.mapping import writer_lock
from offradar_ros.mapping.writer_lock import WriterLock, has_writer


def test_a_writer_is_seen_while_it_holds_the_lock(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    assert not has_writer(path)
    lock = WriterLock(path)
    assert has_writer(path)
    with pytest.raises(MapError, match='in use by another process'):
        WriterLock(path)
    assert has_writer(path)
    lock.release()
    assert not has_writer(path)
    assert list(tmp_path.iterdir()) == []


def test_a_killed_writer_does_not_count(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    code = (
        'import sys, os, signal, pathlib\n'
        'from offradar_ros.mapping.writer_lock import WriterLock\n'
        'lock = WriterLock(pathlib.Path(sys.argv[1]))\n'
        'os.kill(os.getpid(), signal.SIGKILL)\n'
    )
    root = Path(__file__).resolve().parents[2]
    subprocess.run([sys.executable, '-c', code, str(path)], check=False, env=os.environ | {'PYTHONPATH': str(root)})
    assert (tmp_path / 'a.map.lock').exists()
    assert not has_writer(path)


def test_a_lock_that_cannot_be_checked_counts_as_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr('os.open', refuse)
    assert has_writer(tmp_path / 'a.map')


def test_a_check_does_not_block_a_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A busy machine may close the file late.
    monkeypatch.setattr(writer_lock, 'LOCK_WAIT_S', 60.0)
    path = tmp_path / 'a.map'
    checked = os.open(tmp_path / 'a.map.lock', os.O_RDWR | os.O_CREAT)
    fcntl.flock(checked, fcntl.LOCK_SH)
    threading.Timer(0.03, os.close, [checked]).start()
    WriterLock(path).release()


def test_a_link_in_the_place_of_the_lock_is_not_followed(tmp_path: Path) -> None:
    path, link = tmp_path / 'a.map', tmp_path / 'a.map.lock'
    link.symlink_to(tmp_path / 'target')
    with pytest.raises(MapError, match='expected a lock, got a symbolic link: remove it') as refused:
        WriterLock(path)
    assert str(link) in str(refused.value)
    assert has_writer(path)
    assert list(tmp_path.iterdir()) == [link]


def test_a_check_does_not_wait_for_a_fifo(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'a.map.lock')
    done = threading.Thread(target=has_writer, args=[tmp_path / 'a.map'], daemon=True)
    done.start()
    done.join(10.0)
    assert not done.is_alive()
