"""A map holds the signatures of the scans that its places hold or held before, and loses none that was committed."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_maps import (
    MODEL,
    change,
    drive,
    fail_to_write,
    make_map,
    open_map,
    scan,
    signature_of,
)

from offradar_ros.config import MapConfig
from offradar_ros.errors import MapError
from offradar_ros.mapping import held_signatures
from offradar_ros.mapping.map_reader import read_map
from offradar_ros.mapping.sealed_rows import SealedRows
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.stored_map import StoredMap
from offradar_ros.mapping.whole_map import back_up
from offradar_ros.types import Embedding, Pose, ScanKey

Signatures = dict[ScanKey, bytes]


def embedding(stamp: int, uncertainty: float, signature: bytes) -> Embedding:
    mean = np.ones(3, np.float32)
    return Embedding(stamp, mean, np.full(3, uncertainty, np.float32), MODEL.fingerprint, signature)


def scans_in(stored: StoredMap) -> set[ScanKey]:
    """By a loop over places and undo, one by one."""
    found = set()
    for row in range(len(stored.places)):
        found.add(ScanKey(int(stored.places.session_ids[row]), int(stored.places.stamps_ns[row])))
    for before in stored.before.values():
        for place in before.values():
            if place is not None:
                found.add(ScanKey(place.session_id, place.stamp_ns))
    return found


def require_exactly(stored: StoredMap, known: Signatures) -> None:
    """The map has all known signatures of its scans, and no others."""
    assert stored.signatures == {scan: known[scan] for scan in scans_in(stored) if scan in known}


step = st.one_of(
    st.tuples(st.just('merge'), st.sampled_from([0.5, 0.8, 1.0, 1.3]), st.integers(0, 25), st.booleans()),
    st.tuples(st.sampled_from(['start', 'end', 'save', 'undo', 'clear', 'open', 'rescue'])),
)


@settings(max_examples=120, deadline=None)
@given(st.lists(step, max_size=60), st.sampled_from(['nearest', 'worst', 'all']), st.integers(0, 3))
def test_whatever_is_done_the_file_has_those_of_its_scans(
    steps: list[tuple[object, ...]], replace: str, undo_depth: int
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'a.map'
        session_map = open_map(path, replace=replace, undo_depth=undo_depth)
        session_map.adopt_model(MODEL)
        known: Signatures = {}
        stamps = itertools.count(1)
        for what, *arguments in [('start',), *steps, ('end',)]:
            running = session_map.running_session_id
            if what == 'merge' and running is not None:
                uncertainty, metre, has_one = arguments
                stamp = next(stamps)
                content = np.random.default_rng(stamp).bytes(20 + stamp % 9) if has_one else b''
                session_map.merge(embedding(stamp, uncertainty, content), Pose(float(metre), 0.0))  # type: ignore[arg-type]
                if content:
                    known[ScanKey(running, stamp)] = content
                continue
            if what == 'start' and running is None:
                # Of an id that was given before and never stored, nothing is known any more.
                started = session_map.start_session('', 1)
                known = {scan: content for scan, content in known.items() if scan.session_id != started}
            elif what == 'end' and running is not None:
                session_map.end_session()
            elif what == 'save':
                session_map.save()
            elif what == 'undo':
                try:
                    session_map.undo_session()
                except MapError:
                    continue
            elif what == 'clear':
                session_map.clear()
            elif what == 'open':
                session_map.close()
                session_map = open_map(path, replace=replace, undo_depth=undo_depth)
                session_map.adopt_model(MODEL)
            elif what == 'rescue':
                rescued = session_map.rescue()
                assert rescued is not None
                require_exactly(read_map(rescued), known)
            require_exactly(read_map(path), known)
        committed = session_map.committed()
        scans = [
            ScanKey(*key) for key in zip(committed.session_ids.tolist(), committed.stamps_ns.tolist(), strict=True)
        ]
        assert session_map.signatures.read(scans) == {scan: known[scan] for scan in scans if scan in known}
        session_map.close()


@pytest.mark.parametrize('path', ['', 'a.map'])
def test_a_committed_scan_that_the_running_session_replaces_keeps_its_signature(tmp_path: Path, path: str) -> None:
    with SessionMap(MapConfig(path=str(tmp_path / path) if path else '')) as session_map:
        session_map.adopt_model(MODEL)
        drive(session_map, 1.0)
        session_map.end_session()
        committed = session_map.committed()
        drive(session_map, 0.5)
        scans = [ScanKey(1, stamp) for stamp in committed.stamps_ns.tolist()]
        expected = {scan: signature_of(scan.stamp_ns, 1.0) for scan in scans if signature_of(scan.stamp_ns, 1.0)}
        assert len(expected) > 3
        assert session_map.signatures.read(scans) == expected
        session_map.undo_session()
        assert session_map.signatures.read(scans) == expected
        assert session_map.signatures.read([ScanKey(2, stamp) for stamp in range(40)]) == {}


def test_without_undo_the_signature_goes_with_the_scan(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    with open_map(path, undo_depth=0) as session_map:
        session_map.adopt_model(MODEL)
        for uncertainty in (1.0, 0.5):
            drive(session_map, uncertainty)
            session_map.end_session()
            stored = read_map(path)
            assert not stored.before
            assert {scan.session_id for scan in stored.signatures} == set(stored.places.session_ids.tolist())


def test_signatures_of_undo_that_a_shorter_depth_forgets_go_at_the_next_session_only(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    with open_map(path, undo_depth=4) as session_map:
        session_map.adopt_model(MODEL)
        for uncertainty in (1.0, 0.9, 0.8, 0.7):
            drive(session_map, uncertainty)
            session_map.end_session()
    with open_map(path, undo_depth=1) as session_map:
        session_map.undo_session()
    assert {scan.session_id for scan in read_map(path).signatures} == {1, 2, 3}
    with open_map(path, undo_depth=4) as session_map:
        session_map.undo_session()
    stored = read_map(path)
    expected = {ScanKey(2, stamp): signature_of(stamp, 0.9) for stamp in stored.places.stamps_ns.tolist()}
    assert {scan: value for scan, value in stored.signatures.items() if scan.session_id == 2} == {
        scan: value for scan, value in expected.items() if value
    }


def test_of_two_scans_of_one_stamp_the_place_has_the_signature_of_the_one_that_it_holds(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    with open_map(path) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('', 1)
        for uncertainty, signature, expected in (
            (1.0, b'one', {(1, 7): b'one'}),
            (0.9, b'two', {(1, 7): b'two'}),
            (1.5, b'kept out', {(1, 7): b'two'}),
            (0.8, b'', {}),
            (0.7, b'three', {(1, 7): b'three'}),
        ):
            session_map.merge(embedding(7, uncertainty, signature), Pose(0.0, 0.0))
            session_map.save()
            assert read_map(path).signatures == expected


def test_what_could_not_be_written_is_written_the_next_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    before = read_map(path).signatures
    with open_map(path) as session_map:
        drive(session_map, 0.5)
        for name in ('put_signatures', 'remove_signatures'):
            with monkeypatch.context() as patch:
                patch.setattr(SealedRows, name, fail_to_write)
                with pytest.raises(MapError, match='could not be written'):
                    session_map.end_session()
            assert read_map(path).signatures == before
        session_map.end_session()
        stored = read_map(path)
        assert len(stored.signatures) > len(before)
        require_exactly(
            stored,
            {
                ScanKey(session, stamp): signature_of(stamp, uncertainty)
                for session, uncertainty in ((1, 1.0), (2, 0.5))
                for stamp in range(1, 31)
                if signature_of(stamp, uncertainty)
            },
        )


def overwritten(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[:] = bytes(len(content))
    path.write_bytes(content)


@pytest.mark.parametrize('take', [Path.unlink, overwritten])
def test_what_only_the_file_held_when_it_was_taken_away_is_rescued(
    tmp_path: Path, take: Callable[[Path], None]
) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.5)
    expected = read_map(path).signatures
    assert expected
    session_map = open_map(path)
    take(path)
    rescued = session_map.rescue()
    assert rescued is not None
    assert read_map(rescued).signatures == expected
    if take is Path.unlink:
        session_map.save(again=True)
        assert read_map(path).signatures == expected
        drive(session_map, 0.25)
        session_map.end_session()
        assert len(read_map(path).signatures) > len(expected)
    session_map.close()


def test_a_copy_has_them(tmp_path: Path) -> None:
    path, copy = tmp_path / 'a.map', tmp_path / 'b.map'
    make_map(path, 1.0, 0.5)
    back_up(path, copy)
    assert read_map(copy).signatures == read_map(path).signatures
    change(path, 'DELETE FROM signature_contents WHERE content_id = 2')
    copy.unlink()
    with pytest.raises(MapError, match='1 signatures are missing'):
        back_up(path, copy)
    assert not copy.exists()


def test_in_a_long_session_without_a_save_those_that_were_replaced_are_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(held_signatures, 'PUT_BEFORE_CHECK', 10)
    session_map = SessionMap(MapConfig())
    session_map.adopt_model(MODEL)
    drive(session_map, 2.0)
    session_map.end_session()
    session_map.start_session('', 1)
    for k in range(1000):
        session_map.merge(embedding(k, 1.0 - k / 1000.0, b'x'), Pose(0.0, 0.0))
    held = session_map.signatures.read([ScanKey(2, k) for k in range(1000)])
    assert 0 < len(held) <= 10
    assert ScanKey(2, 999) in held
    assert ScanKey(1, 1) in session_map.signatures.read([ScanKey(1, 1)])
    assert scan(1, 2.0).signature


def test_keys_of_more_scans_than_a_statement_takes_are_removed(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    with open_map(path, undo_depth=0) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('', 1)
        for metre in range(0, 12_000, 6):
            session_map.merge(embedding(metre, 1.0, b'one'), Pose(float(metre), 0.0))
        session_map.end_session()
        assert len(read_map(path).signatures) == 2000
        session_map.start_session('', 1)
        for metre in range(0, 12_000, 6):
            session_map.merge(embedding(metre, 0.5, b'another' if metre % 4 else b''), Pose(float(metre), 0.0))
        session_map.end_session()
        stored = read_map(path)
        assert len(stored.signatures) == 1000
        assert set(stored.signatures.values()) == {b'another'}
