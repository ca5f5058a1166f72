"""Signatures are read from a map file while others write, replace or damage it: as they were written, or not at all."""

from __future__ import annotations

import collections
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import pytest
from small_maps import (
    MODEL,
    as_version_1,
    as_version_2,
    change,
    drive,
    folder_state,
    leave_a_log,
    make_map,
    open_map,
    signature_of,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping import map_reader, signature_file
from offradar_ros.mapping.map_reader import log_of, read_map
from offradar_ros.mapping.signature_file import SignatureFile
from offradar_ros.types import ScanKey

PAGE = 16384


def test_it_reads_those_that_the_map_has(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.5)
    expected = dict(read_map(path).signatures)
    before = folder_state(tmp_path)
    source = SignatureFile(path)
    assert source.read([*expected, ScanKey(1, 999), ScanKey(77, 1)]) == expected
    assert source.read([]) == {}
    for scan, signature in expected.items():
        assert source.read([scan]) == {scan: signature}
    source.close()
    assert source.read([ScanKey(2, 1)]) == {ScanKey(2, 1): signature_of(1, 0.5)}
    assert folder_state(tmp_path) == before


def test_beside_a_map_server_it_has_what_was_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'a.map'
    opened: list[str] = []
    open_sqlite = map_reader.open_sqlite

    def counted(path: Path, mode: str) -> sqlite3.Connection:
        opened.append(mode)
        return open_sqlite(path, mode)

    monkeypatch.setattr(signature_file, 'open_sqlite', counted)
    source = SignatureFile(path)
    first, second = ScanKey(1, 1), ScanKey(2, 1)
    with open_map(path) as session_map:
        session_map.adopt_model(MODEL)
        for _ in range(10):
            assert source.read([first]) == {}
        drive(session_map, 1.0)
        assert source.read([first]) == {}
        session_map.save()
        assert source.read([first]) == {first: signature_of(1, 1.0)}
        session_map.end_session()
        drive(session_map, 0.5)
        session_map.save()
        both = {first: signature_of(1, 1.0), second: signature_of(1, 0.5)}
        for _ in range(10):
            assert source.read([first, second]) == both
        session_map.end_session()
        assert session_map.is_file_complete
        assert source.read([first, second]) == both
        session_map.undo_session()
        assert source.read([first, second]) == {first: signature_of(1, 1.0)}
        session_map.clear()
        assert source.read([first, second]) == {}
    # Opened again when it was written, and only then.
    assert len(opened) == 6
    # The reader, which still has the file open, left nothing beside it, and kept nothing there.
    assert {file.name for file in tmp_path.iterdir() if not file.name.endswith('.bak')} == {'a.map'}


def test_another_file_in_its_place_is_noticed(tmp_path: Path) -> None:
    path, other = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    make_map(other, 0.5)
    source = SignatureFile(path)
    scan = ScanKey(1, 1)
    assert source.read([scan]) == {scan: signature_of(1, 1.0)}
    shutil.copy(path, tmp_path / 'kept')
    shutil.copy(other, path)
    assert source.read([scan]) == {scan: signature_of(1, 0.5)}
    (tmp_path / 'kept').replace(path)
    assert source.read([scan]) == {scan: signature_of(1, 1.0)}
    path.unlink()
    with pytest.raises(MapError, match='no map file there'):
        source.read([scan])
    path.mkdir()
    with pytest.raises(MapError, match='not a file'):
        source.read([scan])
    path.rmdir()
    other.rename(path)
    assert source.read([scan]) == {scan: signature_of(1, 0.5)}


@pytest.mark.parametrize('rewrite', [as_version_1, as_version_2])
def test_a_map_of_an_earlier_version_has_none(tmp_path: Path, rewrite: Callable[[Path], None]) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    rewrite(path)
    source = SignatureFile(path)
    assert source.read([ScanKey(1, 1)]) == {}
    open_map(path).close()
    assert source.read([ScanKey(1, 1)]) == {}
    with open_map(path) as session_map:
        drive(session_map, 0.5)
        session_map.end_session()
    assert source.read([ScanKey(2, 1)]) == {ScanKey(2, 1): signature_of(1, 0.5)}


@pytest.mark.parametrize(
    ('statement', 'reason'),
    [
        ("UPDATE signature_contents SET content = x'00'", 'is not as written'),
        ("UPDATE signature_contents SET content = 'text'", 'is not one'),
        ('UPDATE signature_contents SET content = zeroblob(8193)', 'is not one'),
        ('DELETE FROM signature_contents', 'is not one'),
        ('UPDATE signatures SET digest = digest + 1', 'is not as written'),
        ("UPDATE signatures SET digest = 'text'", 'is not as written'),
        ('UPDATE signatures SET stamp_ns = stamp_ns + 1000', 'is not as written'),
        ('DROP TABLE signature_contents', 'its tables are not those of a map'),
        ("UPDATE meta SET value = '1' WHERE key = 'seal'", 'damaged'),
        ('PRAGMA application_id = 7', 'not a map written by offradar'),
        ('PRAGMA user_version = 99', 'newer version of offradar'),
    ],
)
def test_what_is_not_as_written_is_refused_in_one_line(tmp_path: Path, statement: str, reason: str) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    change(path, statement)
    source = SignatureFile(path)
    scan = ScanKey(1, 1001 if '1000' in statement else 1)
    for _ in range(2):
        with pytest.raises(MapError, match=reason) as refused:
            source.read([scan])
        assert str(path) in str(refused.value) and '\n' not in str(refused.value)


def test_one_that_is_damaged_does_not_keep_others_from_being_read(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    scans = sorted(read_map(path).signatures)
    change(path, "UPDATE signature_contents SET content = x'00' WHERE content_id = 2")
    source = SignatureFile(path)
    damaged = []
    for scan in scans:
        try:
            assert source.read([scan]) == {scan: signature_of(scan.stamp_ns, 1.0)}
        except MapError:
            damaged.append(scan)
    assert len(damaged) == 1
    with pytest.raises(MapError, match='is not as written'):
        source.read(scans)


def test_no_damage_gives_another_signature_or_another_error(tmp_path: Path) -> None:
    sound, path = tmp_path / 'sound.map', tmp_path / 'a.map'
    make_map(sound, 1.0, 0.5)
    expected = read_map(sound).signatures
    rng = random.Random(1)
    outcomes = collections.Counter[str]()
    for _ in range(300):
        content = bytearray(sound.read_bytes())
        kind = rng.choice(['bit', 'page', 'cut'])
        if kind == 'bit':
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        elif kind == 'page':
            start = PAGE * rng.randrange(len(content) // PAGE)
            content[start : start + PAGE] = rng.randbytes(PAGE)
        else:
            del content[rng.randrange(len(content)) :]
        path.write_bytes(content)
        source = SignatureFile(path)
        try:
            found = source.read(list(expected))
        except MapError as refused:
            assert '\n' not in str(refused)
            outcomes['refused'] += 1
        else:
            assert found.items() <= expected.items()
            outcomes['same' if found == expected else 'some are missing'] += 1
        source.close()
    assert outcomes['refused'] > 30 and outcomes['same'] > 30


def test_the_log_of_a_killed_writer_counts_and_that_of_another_map_does_not(tmp_path: Path) -> None:
    path, other = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0)
    make_map(other, 0.7)
    source = SignatureFile(path)
    scan = ScanKey(2, 1)
    assert source.read([scan]) == {}
    leave_a_log(path, 0.5)
    for _ in range(2):
        assert source.read([scan]) == {scan: signature_of(1, 0.5)}
    assert log_of(path).stat().st_size
    shutil.copy(other, path)
    assert source.read([scan, ScanKey(1, 1)]) == {ScanKey(1, 1): signature_of(1, 0.7)}


def test_a_path_that_cannot_lead_to_a_file_is_a_missing_file(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    source = SignatureFile(path / 'below')
    with pytest.raises(MapError, match='no map file there'):
        source.read([ScanKey(1, 1)])


WRITE_ON = """
    import sys
    from small_maps import *
    session_map = open_map(Path(sys.argv[1]), undo_depth=1)
    session_map.adopt_model(MODEL)
    print('writes', flush=True)
    for k in range(10_000):
        drive(session_map, 1.0 / (k + 2), 1000.0)
        session_map.save()
        session_map.end_session()
        if k % 3 == 0:
            session_map.undo_session()
"""


def test_while_another_process_writes_what_was_committed_is_always_read(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    expected = dict(read_map(path).signatures)
    root = Path(__file__).resolve().parents[2]
    paths = [str(root), str(root / 'test' / 'support'), os.environ.get('PYTHONPATH', '')]
    writer = subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(WRITE_ON), str(path)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(paths)},
    )
    source = SignatureFile(path)
    states, busy = set[int](), 0
    with writer:
        try:
            assert writer.stdout is not None
            assert writer.stdout.readline() == 'writes\n'
            while len(states) < 40:
                assert writer.poll() is None
                states.add(path.stat().st_mtime_ns)
                try:
                    assert source.read(list(expected)) == expected
                except MapError as error:
                    assert 'again and again' in str(error)
                    busy += 1
        finally:
            writer.kill()
    assert busy < 20
    assert source.read(list(expected)) == expected
