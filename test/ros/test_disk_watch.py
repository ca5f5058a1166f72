"""A map file that cannot be written is told of before something is to be saved."""

from __future__ import annotations

import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest
from unprivileged import obey_permissions

from offradar_ros.ros.disk_watch import FULL_BYTES, LOW_BYTES, disk_trouble

Usage = namedtuple('Usage', 'total used free')
PROJECT = Path(__file__).resolve().parents[2]


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    path = tmp_path / 'town.db'
    path.write_bytes(b'x')
    return path


@pytest.mark.parametrize(
    ('free', 'cause', 'is_error'),
    [(LOW_BYTES, None, False), (LOW_BYTES - 1, 'disk_nearly_full', False), (FULL_BYTES - 1, 'disk_nearly_full', True)],
)
def test_a_disk_that_is_nearly_full(
    map_file: Path, monkeypatch: pytest.MonkeyPatch, free: int, cause: str | None, is_error: bool
) -> None:
    monkeypatch.setattr('shutil.disk_usage', lambda _: Usage(10**12, 10**12 - free, free))
    trouble = disk_trouble(map_file)
    assert (trouble and trouble.cause) == cause
    assert trouble is None or trouble.is_error == is_error


def test_a_file_that_is_gone(map_file: Path) -> None:
    map_file.unlink()
    trouble = disk_trouble(map_file)
    assert trouble is not None
    assert (trouble.cause, trouble.is_error) == ('map_file_gone', True)
    assert str(map_file) in trouble.text


@pytest.mark.parametrize('what', ['file', 'folder'])
def test_a_file_that_may_not_be_written(map_file: Path, what: str) -> None:
    locked = map_file if what == 'file' else map_file.parent
    locked.chmod(0o500)
    program = (
        'import sys, pathlib; from offradar_ros.ros.disk_watch import disk_trouble; '
        'print(disk_trouble(pathlib.Path(sys.argv[1])))'
    )
    try:
        ran = subprocess.run(
            [sys.executable, '-c', program, str(map_file)],
            cwd=PROJECT,
            capture_output=True,
            text=True,
            check=True,
            preexec_fn=obey_permissions,
        )
    finally:
        locked.chmod(0o700)
    assert "cause='map_not_writable'" in ran.stdout
    assert f'{locked}: cannot be written' in ran.stdout
