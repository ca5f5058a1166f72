"""A map that lacks what was acknowledged, holds half of a session or other content is found out."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from faults.acknowledged_sessions import EITHER, ENDED, INFO, UNDONE, judge, known_embedding
from faults.result import DIFFERENT, LOST, SAME

from offradar_ros.config import MapConfig
from offradar_ros.mapping import map_reader
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.types import Pose, ScanKey


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / 'map.db'
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(INFO)
        for session in range(2):
            session_map.start_session('', session)
            for k in range(3):
                stamp = 10 * session + k
                session_map.merge(known_embedding(stamp), Pose(50.0 * stamp, 0.0))
            session_map.end_session()
    return path


def test_all_is_there(path: Path) -> None:
    assert judge(path, {1: ENDED, 2: ENDED}).word == SAME
    assert judge(path, {1: ENDED, 2: EITHER}).word == SAME
    assert judge(path.with_name('none.db'), {}).word == SAME


def test_what_is_missing_is_lost(path: Path) -> None:
    assert judge(path, {1: ENDED, 3: ENDED}).word == LOST
    assert judge(path, {2: UNDONE}).word == LOST
    assert judge(path.with_name('none.db'), {1: ENDED}).word == LOST
    path.write_bytes(b'no map')
    assert judge(path, {1: ENDED}).word == LOST


def test_a_signature_that_is_missing_is_lost_and_another_one_is_different(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = map_reader.read_map(path)
    held = dict(stored.signatures)
    scan = min(held)
    for signatures, word in (
        (held, SAME),
        ({other: content for other, content in held.items() if other != scan}, LOST),
        (held | {scan: b'another'}, DIFFERENT),
        (held | {ScanKey(7, 7): b'of no place'}, DIFFERENT),
    ):
        read = dataclasses.replace(stored, signatures=signatures)
        monkeypatch.setattr(MapStore, 'open_read_only', lambda _, read=read: read)
        assert judge(path, {1: ENDED, 2: ENDED}).word == word


def test_half_of_a_session_and_other_content_are_different(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored = map_reader.read_map(path)
    half = stored.places.__class__(*(getattr(stored.places, name)[1:] for name in stored.places.__slots__))
    monkeypatch.setattr(type(stored), 'places', half)
    assert judge(path, {1: ENDED}).word == DIFFERENT
    other = stored.columns.table
    other.means[0, 0] += 1.0
    monkeypatch.setattr(type(stored), 'places', other)
    assert judge(path, {1: ENDED}).word == DIFFERENT
