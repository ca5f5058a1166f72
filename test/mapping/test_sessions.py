"""Sessions of the map: committed, running and undone ones."""

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.config import MapConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.types import Embedding, PlaceTable, Pose

MODEL = ModelInfo('ring_key', 'a' * 64, 3, {'note': 'test'})
OTHER = ModelInfo('variational', 'b' * 64, 5, {})


def scan(stamp: int, uncertainty: float, model: ModelInfo = MODEL) -> Embedding:
    mean = np.full(model.dimension, stamp, np.float32)
    return Embedding(stamp, mean, np.full(model.dimension, uncertainty, np.float32), model.fingerprint)


def drive(session_map: SessionMap, name: str, start_m: float, uncertainty: float, metres: int = 30) -> None:
    session_map.start_session(name, 1)
    for metre in range(metres):
        session_map.merge(scan(1000 * len(name) + metre, uncertainty), Pose(start_m + metre, 0.0))


def tables_equal(one: PlaceTable, other: PlaceTable) -> bool:
    fields = dataclasses.fields(one)
    return all(np.array_equal(getattr(one, f.name), getattr(other, f.name), equal_nan=True) for f in fields)


@pytest.fixture(params=['memory', 'file'])
def session_map(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[SessionMap]:
    path = str(tmp_path / 'a.map') if request.param == 'file' else ''
    with SessionMap(MapConfig(path=path)) as opened:
        opened.adopt_model(MODEL)
        yield opened


def test_the_report_counts_every_scan(session_map: SessionMap) -> None:
    session_map.start_session('first', 1)
    for metre in range(20):
        session_map.merge(scan(metre, 1.0), Pose(metre * 1.0, 0.0))
    first = session_map.end_session()
    assert (first.inserted, first.replaced, first.kept, dict(first.dropped)) == (4, 0, 16, {})
    assert (first.places_before, first.places_after) == (0, 4)
    assert math.isnan(first.mean_uncertainty_before) and first.mean_uncertainty_after == 1.0
    session_map.start_session('second', 2)
    session_map.merge(scan(100, 0.5), Pose(0.0, 0.0))
    session_map.merge(scan(101, 1.5), Pose(0.0, 0.0))
    session_map.merge(scan(102, 1.5), Pose(-50.0, 0.0))
    for cause in ('no_position', 'no_position', 'invalid_embedding'):
        session_map.count_dropped(cause)
    second = session_map.end_session()
    assert (second.inserted, second.replaced, second.kept) == (1, 1, 1)
    assert second.dropped == {'no_position': 2, 'invalid_embedding': 1}
    assert (second.mean_uncertainty_before, second.mean_uncertainty_after) == (1.0, 1.0)
    assert second.summary() == (
        'session 2 (second): 1 inserted, 1 replaced, 1 kept, 3 dropped (1 invalid_embedding, 2 no_position); '
        'places 4 -> 5, mean U 1.000 -> 1.000'
    )
    assert first.as_dict()['mean_uncertainty_before'] is None
    assert second.as_dict()['dropped'] == {'no_position': 2, 'invalid_embedding': 1}


def test_committed_is_the_map_without_the_running_session(session_map: SessionMap) -> None:
    drive(session_map, 'one', 0.0, 1.0)
    assert len(session_map.committed()) == 0
    session_map.end_session()
    before = session_map.committed()
    drive(session_map, 'two!', 15.0, 0.5)
    assert tables_equal(session_map.committed(), before)
    running = session_map.running()
    assert set(running.session_ids.tolist()) == {2} and len(running) < len(session_map.places())
    assert min(running.place_ids) < len(before) <= max(running.place_ids)
    session_map.end_session()
    assert tables_equal(session_map.committed(), session_map.places())
    assert len(session_map.running()) == 0


def test_changes_of_one_merge(session_map: SessionMap) -> None:
    session_map.start_session('one', 1)
    inserted = session_map.changed(session_map.merge(scan(7, 1.0), Pose(1.0, 2.0)))
    assert inserted.stamps_ns.tolist() == [7] and inserted.positions_m[0].tolist() == [1.0, 2.0, 0.0]
    assert len(session_map.changed(session_map.merge(scan(8, 1.0), Pose(1.0, 2.0)))) == 0
    replaced = session_map.changed(session_map.merge(scan(9, 0.5), Pose(1.0, 3.0)))
    assert replaced.place_ids.tolist() == inserted.place_ids.tolist() and replaced.stamps_ns.tolist() == [9]


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.lists(st.tuples(st.sampled_from([0.5, 0.8, 1.0, 1.3]), st.integers(0, 40)), max_size=15),
        min_size=1,
        max_size=6,
    ),
    st.sampled_from(['nearest', 'worst', 'all']),
    st.sampled_from(['anchor', 'pose']),
    st.booleans(),
)
def test_undo_restores_each_earlier_state(
    sessions: list[list[tuple[float, int]]], replace: str, match_position: str, discard: bool
) -> None:
    with SessionMap(MapConfig(replace=replace, match_position=match_position, undo_depth=4)) as session_map:
        session_map.adopt_model(MODEL)
        states = [session_map.places()]
        for number, scans in enumerate(sessions):
            session_map.start_session(f's{number}', number)
            for i, (uncertainty, metre) in enumerate(scans):
                session_map.merge(scan(100 * number + i, uncertainty), Pose(metre * 1.0, 0.0))
            if discard and number == len(sessions) - 1:
                assert session_map.undo_session().was_running
                states.append(session_map.places())
                assert tables_equal(states[-1], states[-2])
                states.pop()
            else:
                report = session_map.end_session()
                # A session without changes does not count among those that can be undone.
                if report.inserted + report.replaced:
                    states.append(session_map.places())
        for state in states[::-1][1:][:4]:
            assert not session_map.undo_session().was_running
            assert tables_equal(session_map.places(), state)
        if len(states) > 5 or len(states) == 5:
            with pytest.raises(MapError, match='no session to undo'):
                session_map.undo_session()


def test_undo_reports_in_one_line(session_map: SessionMap) -> None:
    with pytest.raises(MapError, match='no session to undo'):
        session_map.undo_session()
    drive(session_map, 'one', 0.0, 1.0)
    session_map.end_session()
    drive(session_map, 'two!', 0.0, 0.5, metres=50)
    report = session_map.undo_session()
    assert str(report) == 'session 2 (two!) discarded: 4 places removed, 6 restored; 6 places'
    assert session_map.running_session_id is None
    assert 'session 1 (one) undone' in str(session_map.undo_session())
    assert len(session_map) == 0


def test_with_undo_depth_0_only_the_running_session_can_be_undone() -> None:
    with SessionMap(MapConfig(undo_depth=0)) as session_map:
        session_map.adopt_model(MODEL)
        drive(session_map, 'one', 0.0, 1.0)
        session_map.end_session()
        drive(session_map, 'two!', 100.0, 1.0)
        session_map.undo_session()
        assert len(session_map) == 6
        with pytest.raises(MapError, match='undo_depth is 0'):
            session_map.undo_session()


def test_ids_are_not_reused_after_an_undo(session_map: SessionMap) -> None:
    drive(session_map, 'one', 0.0, 1.0)
    session_map.undo_session()
    assert session_map.start_session('two', 1) == 2
    merge = session_map.merge(scan(1, 1.0), Pose(0.0, 0.0))
    assert merge.place_ids == (6,)


def test_outside_a_session_nothing_is_mapped_or_counted(session_map: SessionMap) -> None:
    session_map.count_dropped('no_position')
    with pytest.raises(RefusedInput) as refused:
        session_map.merge(scan(1, 1.0), Pose(0.0, 0.0))
    assert refused.value.cause == 'no_session'
    with pytest.raises(MapError, match='no session runs'):
        session_map.end_session()
    session_map.start_session('one', 1)
    with pytest.raises(MapError, match=r'session 1 \(one\) runs'):
        session_map.start_session('two', 1)
    assert session_map.end_session().dropped == {}


def test_embeddings_of_another_model_are_refused(session_map: SessionMap) -> None:
    session_map.start_session('one', 1)
    with pytest.raises(RefusedInput) as refused:
        session_map.merge(scan(1, 1.0, OTHER), Pose(0.0, 0.0))
    assert refused.value.cause == 'wrong_model' and 'bbbb' in str(refused.value) and 'aaaa' in str(refused.value)
    assert len(session_map) == 0


def test_before_a_model_is_known_nothing_is_mapped() -> None:
    session_map = SessionMap(MapConfig())
    session_map.start_session('one', 1)
    with pytest.raises(RefusedInput) as refused:
        session_map.merge(scan(1, 1.0), Pose(0.0, 0.0))
    assert refused.value.cause == 'no_model'
    assert session_map.model is None and session_map.dimension == 0 and len(session_map.committed()) == 0


def test_only_an_empty_map_changes_its_model(session_map: SessionMap) -> None:
    session_map.adopt_model(OTHER)
    session_map.adopt_model(MODEL)
    drive(session_map, 'one', 0.0, 1.0)
    with pytest.raises(MapError, match='holds embeddings of ring_key aaaaaaaaaaaa, not of variational bbbbbbbbbbbb'):
        session_map.adopt_model(OTHER)
    session_map.end_session()
    session_map.adopt_model(MODEL)
    with pytest.raises(MapError):
        session_map.adopt_model(OTHER)
    assert session_map.model == MODEL and len(session_map) == 6


def test_the_origin_is_set_once(session_map: SessionMap) -> None:
    assert session_map.origin is None
    session_map.set_origin(GeoPoint(51.75, -1.26, 60.0))
    session_map.set_origin(GeoPoint(51.75, -1.26, 60.0))
    with pytest.raises(MapError, match=r'latitude_deg=51\.75'):
        session_map.set_origin(GeoPoint(36.0, 127.0))
    assert session_map.origin == GeoPoint(51.75, -1.26, 60.0)


def test_clear_empties_the_map_and_the_running_session_goes_on(session_map: SessionMap) -> None:
    drive(session_map, 'one', 0.0, 1.0)
    session_map.end_session()
    drive(session_map, 'two!', 100.0, 1.0)
    copy = session_map.clear()
    assert len(session_map) == 0 and len(session_map.committed()) == 0 and len(session_map.running()) == 0
    session_map.merge(scan(1, 1.0), Pose(0.0, 0.0))
    report = session_map.end_session()
    assert (report.session_id, report.inserted, report.places_before, report.places_after) == (2, 1, 0, 1)
    assert (copy is None) == (not session_map.config.path)
    if copy:
        with SessionMap(MapConfig(path=str(copy))) as kept:
            assert len(kept) == 12
            assert kept.undo_session().session_id == 2
            assert len(kept) == 6


def test_a_map_in_memory_cannot_be_saved() -> None:
    with pytest.raises(MapError, match=r'map\.path is empty'):
        SessionMap(MapConfig()).save()


def test_a_session_without_scans_is_not_stored_and_uses_no_undo(tmp_path: Path) -> None:
    path = tmp_path / 'map.db'
    with SessionMap(MapConfig(path=str(path), undo_depth=1)) as session_map:
        session_map.adopt_model(MODEL)
        drive(session_map, 'real', 0.0, 1.0)
        session_map.end_session()
        for number in range(3):
            session_map.start_session(f'empty {number}', number)
            assert session_map.is_session_empty
            session_map.save()
            session_map.end_session()
        session_map.start_session('nothing new', 9)
        session_map.merge(scan(10**6, 99.0), Pose(0.0, 0.0))
        session_map.end_session()
    with SessionMap(MapConfig(path=str(path), undo_depth=1)) as session_map:
        assert [s.name for s in MapStore.open_read_only(path).sessions] == ['real', 'nothing new']
        assert session_map.undo_session().name == 'real'
        assert len(session_map) == 0


def test_the_same_model_again_does_not_interrupt_the_running_session(tmp_path: Path) -> None:
    path = tmp_path / 'map.db'
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.start_session('one', 0)
        session_map.adopt_model(MODEL)
        session_map.merge(scan(1, 1.0), Pose(0.0, 0.0))
        session_map.save()
        session_map.adopt_model(MODEL)
        assert [s.state for s in MapStore.open_read_only(path).sessions] == ['running']
        assert len(MapStore.open_read_only(path).committed()) == 0


def test_two_names_of_one_file_are_one_map(tmp_path: Path) -> None:
    (tmp_path / 'link.db').symlink_to(tmp_path / 'map.db')
    with (
        SessionMap(MapConfig(path=str(tmp_path / 'map.db'))),
        pytest.raises(MapError, match='in use by another process that writes it'),
    ):
        SessionMap(MapConfig(path=str(tmp_path / 'link.db')))


def test_the_maps_fingerprint_with_another_dimension_is_another_model(tmp_path: Path) -> None:
    config = MapConfig(path=str(tmp_path / 'a.map'))
    forged = dataclasses.replace(MODEL, dimension=MODEL.dimension + 1)
    with SessionMap(config) as session_map:
        # An empty map takes either: whichever came first, the true one is not locked out.
        session_map.adopt_model(forged)
        session_map.adopt_model(MODEL)
        drive(session_map, 'one', 0.0, 1.0)
        for _ in range(2):
            with pytest.raises(MapError, match=r'd = 3, not 4'):
                session_map.adopt_model(forged)
            session_map.end_session() if session_map.running_session_id else None
    with SessionMap(config) as again:
        assert (again.model, len(again)) == (MODEL, 6)
        with pytest.raises(MapError, match=r'd = 3, not 4'):
            again.adopt_model(forged)
    assert MapStore.open_read_only(Path(config.path)).model == MODEL


def test_other_metadata_of_the_same_model_is_not_written_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[ModelInfo] = []
    monkeypatch.setattr(MapStore, 'write_model', lambda _, info, **__: written.append(info))
    with SessionMap(MapConfig(path=str(tmp_path / 'a.map'))) as session_map:
        for number in range(20):
            session_map.adopt_model(dataclasses.replace(MODEL, metadata={'number': str(number)}))
    assert [info.metadata for info in written] == [{'number': '0'}]
