"""The map stage: each embedding is mapped or refused exactly once. The test sets the clock."""

from __future__ import annotations

import dataclasses
import math
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.alignment.signature_code import checksum_of
from offradar_ros.config import Config, MapConfig, PositionConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame, wrap_angle
from offradar_ros.mapping.sealed_rows import SealedRows
from offradar_ros.mapping.session_report import SessionReport
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.stages import map as map_stage
from offradar_ros.stages.map import Form, MapStage, MapUpdate
from offradar_ros.types import Embedding, Pose, ScanKey

SECOND = 10**9
MODEL = ModelInfo('stub', 'ab' * 32, 2, {})
# A course over ground is known only after some more positions.
CONFIG = Config(position=PositionConfig(heading='none'))


@pytest.fixture
def session_map() -> Iterator[SessionMap]:
    with SessionMap(MapConfig(match_distance_m=1.0)) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('test', 0)
        yield session_map


@pytest.fixture
def stage(session_map: SessionMap) -> MapStage:
    return MapStage(CONFIG, session_map)


def embedding(seconds: float, model: str = MODEL.fingerprint, dimension: int = 2) -> Embedding:
    values = np.ones(dimension, np.float32)
    return Embedding(round(seconds * SECOND), values, values, model)


def at(seconds: float) -> tuple[int, Pose]:
    """A vehicle at 10 m/s eastwards."""
    return round(seconds * SECOND), Pose(10.0 * seconds, 2.0)


def brief(updates: Sequence[MapUpdate]) -> list[tuple[float, float | str]]:
    """Stamp (s) of each update, and x (m) of the place that it changed or the cause of its refusal."""
    return [
        (u.stamp_ns / SECOND, u.problem.cause if u.problem else float(u.changed.positions_m[0, 0])) for u in updates
    ]


def test_a_scan_waits_for_the_position_after_it(stage: MapStage) -> None:
    assert brief(stage.add_pose(*at(1.0))) == []
    assert brief(stage.add_embedding(embedding(1.25))) == []
    assert brief(stage.add_embedding(embedding(1.75))) == []
    assert brief(stage.add_pose(*at(1.5))) == [(1.25, 12.5)]
    assert brief(stage.add_pose(*at(2.0))) == [(1.75, 17.5)]
    assert brief(stage.add_embedding(embedding(2.0))) == [(2.0, 20.0)]


@given(st.lists(st.integers(1, 60), min_size=1, max_size=12, unique=True), st.randoms(use_true_random=False))
@settings(max_examples=60, deadline=None)
def test_each_scan_is_resolved_once_and_in_order(tenths: list[int], random: Any) -> None:
    with SessionMap(MapConfig(match_distance_m=0.01)) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('test', 0)
        stage = MapStage(CONFIG, session_map)
        scans = [('scan', t / 10) for t in sorted(tenths)]
        positions = [('position', t / 4) for t in range(30)]
        updates: list[MapUpdate] = []
        while scans or positions:
            kind, seconds = (scans if scans and (not positions or random.random() < 0.5) else positions).pop(0)
            updates += stage.add_embedding(embedding(seconds)) if kind == 'scan' else stage.add_pose(*at(seconds))
        updates += stage.flush()
        found = brief(updates)
    assert [seconds for seconds, _ in found] == [t / 10 for t in sorted(tenths)]
    assert [x for _, x in found] == pytest.approx([float(t) for t in sorted(tenths)])


def test_a_small_jump_back_of_positions_is_refused(stage: MapStage) -> None:
    stage.add_pose(*at(1.0))
    for seconds, cause in ((1.0, 'repeated_position_stamp'), (0.5, 'position_stamp_backwards')):
        with pytest.raises(RefusedInput) as refused:
            stage.add_pose(round(seconds * SECOND), Pose(1000.0, 1000.0))
        assert refused.value.cause == cause
    stage.add_embedding(embedding(1.25))
    assert brief(stage.add_pose(*at(1.5))) == [(1.25, 12.5)]


def test_a_jump_back_of_positions_starts_again(stage: MapStage) -> None:
    stage.add_pose(*at(100.0))
    stage.add_embedding(embedding(100.25))
    # One position may be wrong: the recording starts again when the scans do, too.
    assert brief(stage.add_pose(*at(50.0))) == []
    # The waiting scan gets no position, and nothing is interpolated between the two recordings.
    assert brief(stage.add_embedding(embedding(50.25))) == [(100.25, 'no_position')]
    assert brief(stage.add_pose(*at(50.5))) == [(50.25, 502.5)]


def test_positions_that_stay_back_start_again_without_scans(stage: MapStage) -> None:
    for tenths in range(20):
        stage.add_pose(*at(100.0 + tenths / 10))
    for tenths in range(21):
        stage.add_pose(*at(50.0 + tenths / 10))
    assert stage.take_left_out() == []
    assert brief(stage.add_embedding(embedding(51.25))) == [(51.25, 512.5)]


def test_a_jump_back_of_scans_drops_waiting_ones(stage: MapStage) -> None:
    stage.add_pose(*at(100.0))
    stage.add_embedding(embedding(100.25))
    assert brief(stage.add_embedding(embedding(50.0))) == [(100.25, 'no_position')]
    # Its positions may still arrive; those of the earlier run are not used.
    stage.add_pose(*at(49.75))
    assert brief(stage.add_pose(*at(50.25))) == [(50.0, 500.0)]


def test_positions_are_not_interpolated_across_a_gap(stage: MapStage) -> None:
    for seconds in (1.0, 1.5, 9.5, 10.0):
        stage.add_pose(*at(seconds))
    found = [brief(stage.add_embedding(embedding(seconds))) for seconds in (0.5, 1.25, 5.0, 9.5, 9.75)]
    assert [update for (update,) in found] == [
        (0.5, 'no_position'),
        (1.25, 12.5),
        (5.0, 'no_position'),
        (9.5, 95.0),
        (9.75, 97.5),
    ]


def test_a_scan_without_a_position_is_dropped_after_the_wait(stage: MapStage) -> None:
    stage.add_embedding(embedding(1.0))
    assert brief(stage.add_embedding(embedding(11.0))) == []
    assert brief(stage.add_embedding(embedding(11.5))) == [(1.0, 'no_position')]
    assert brief(stage.flush()) == [(11.0, 'no_position'), (11.5, 'no_position')]
    assert brief(stage.flush()) == []


def test_the_origin_is_the_first_geodetic_position(session_map: SessionMap) -> None:
    origin = GeoPoint(51.75, -1.25, 70.0)
    east = LocalFrame(origin).to_geodetic(np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0]]))
    stage = MapStage(CONFIG, session_map)
    stage.add_point(0, GeoPoint(*east[0]))
    stage.add_point(SECOND, GeoPoint(*east[1]))
    ((stamp_s, x_m),) = brief(stage.add_embedding(embedding(1.0)))
    assert stamp_s == 1.0
    assert x_m == pytest.approx(50.0, abs=1e-6)
    # A later drive starts elsewhere, in the same frame.
    later = MapStage(CONFIG, session_map)
    later.add_point(5 * SECOND, GeoPoint(*east[1]))
    more_certain = dataclasses.replace(embedding(5.0), variance=np.full(2, 0.5, np.float32))
    ((stamp_s, x_m),) = brief(later.add_embedding(more_certain))
    assert stamp_s == 5.0
    assert x_m == pytest.approx(50.0, abs=1e-6)
    assert session_map.origin == GeoPoint(*east[0])


def test_a_report_counts_every_embedding(stage: MapStage, session_map: SessionMap) -> None:
    for seconds in np.arange(0.0, 3.0, 0.5):
        stage.add_pose(*at(float(seconds)))
    sent = [
        embedding(0.0),
        embedding(0.01),
        dataclasses.replace(embedding(0.02), variance=np.full(2, 0.5, np.float32)),
        embedding(1.0, dimension=0),
        embedding(1.1, dimension=3),
        embedding(1.2, model='cd' * 32),
        dataclasses.replace(embedding(1.3), mean=np.array([np.nan, 1.0], np.float32)),
        embedding(2.0),
        embedding(9.0),
    ]
    updates = [update for item in sent for update in stage.add_embedding(item)]
    last, report = stage.end_session()
    assert Counter(u.stamp_ns for u in [*updates, *last]) == Counter(e.stamp_ns for e in sent)
    assert (report.inserted, report.replaced, report.kept) == (2, 1, 1)
    assert dict(report.dropped) == {'invalid_embedding': 3, 'wrong_model': 1, 'no_position': 1}
    assert report.inserted + report.replaced + report.kept + sum(report.dropped.values()) == len(sent)
    assert len(session_map) == report.places_after == 2


def test_without_a_session_nothing_is_mapped() -> None:
    with SessionMap(MapConfig()) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(CONFIG, session_map)
        stage.add_pose(*at(1.0))
        assert stage.add_embedding(embedding(1.0)) == []
        assert stage.add_embedding(embedding(2.0, dimension=0)) == []
        session_map.start_session('later', 0)
        assert stage.add_pose(*at(3.0)) == []
        assert len(session_map) == 0


def test_the_origin_is_that_of_the_first_mapped_drive() -> None:
    """A first position at 0°, 0°, which some receivers report, becomes neither the origin nor a place."""
    stage = MapStage(CONFIG, SessionMap(MapConfig()))
    stage.map.adopt_model(MODEL)
    here = GeoPoint(51.75, -1.25, 70.0)
    with pytest.raises(RefusedInput, match='stands for no fix') as refusal:
        stage.add_point(SECOND, GeoPoint(0.0, 0.0, 0.0))
    assert refusal.value.cause == 'no_fix'
    assert stage.map.origin is None
    stage.add_point(2 * SECOND, here)
    stage.map.start_session('one', 0)
    stage.add_point(3 * SECOND, here)
    stage.add_embedding(embedding(2.5))
    assert stage.map.origin == here
    assert len(stage.map) == 1
    stage.end_session()
    stage.add_point(4 * SECOND, GeoPoint(10.0, 10.0, 0.0))
    (far,) = stage.take_left_out()
    assert far.cause == 'far_position'
    assert "km from the map's origin: expected at most 100 km" in far.first


def test_waiting_scans_are_dropped_with_their_session(stage: MapStage) -> None:
    stage.add_pose(*at(1.0))
    stage.add_embedding(embedding(1.5))
    stage.undo_session()
    stage.map.start_session('next', 0)
    assert stage.add_pose(*at(2.0)) == []
    assert len(stage.map) == 0


class Clock:
    """A monotonic clock that the test sets."""

    def __init__(self) -> None:
        self.seconds = 1000.0

    def __call__(self) -> float:
        return self.seconds


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def stored(tmp_path: Path, clock: Clock) -> Iterator[MapStage]:
    """A stage on a map in a file, without a model yet and with a running session."""
    config = Config(
        position=CONFIG.position, map=MapConfig(path=str(tmp_path / 'map.db'), match_distance_m=1.0, autosave_s=10.0)
    )
    with SessionMap(config.map) as session_map:
        session_map.start_session('test', 0)
        yield MapStage(config, session_map, clock)


def test_scans_wait_for_their_model(stored: MapStage) -> None:
    for seconds in (1.0, 2.0, 3.0):
        stored.add_pose(*at(seconds))
    assert stored.add_embedding(embedding(1.5)) == []
    assert stored.add_embedding(embedding(2.5)) == []
    assert brief(stored.adopt_model(MODEL)) == [(1.5, 15.0), (2.5, 25.0)]
    assert stored.adopt_model(MODEL) == []


def test_the_number_of_scans_that_wait_for_a_model_is_bounded(
    stored: MapStage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_stage, 'MAX_WAITING_FOR_MODEL', 2)
    updates = [update for s in (1.0, 2.0, 3.0, 4.0) for update in stored.add_embedding(embedding(s))]
    assert brief(updates) == [(1.0, 'no_model'), (2.0, 'no_model')]
    last, report = stored.end_session()
    assert brief(last) == [(3.0, 'no_model'), (4.0, 'no_model')]
    assert dict(report.dropped) == {'no_model': 4}
    stored.map.start_session('next', 0)
    assert stored.adopt_model(MODEL) == []


@pytest.mark.parametrize('forget', [MapStage.undo_session, MapStage.clear])
def test_scans_that_wait_for_a_model_are_dropped_with_their_session(
    stored: MapStage, forget: Callable[[MapStage], object]
) -> None:
    stored.add_pose(*at(1.0))
    stored.add_embedding(embedding(1.0))
    forget(stored)
    assert stored.adopt_model(MODEL) == []


def test_another_model_than_the_map_s_is_refused(stage: MapStage) -> None:
    stage.add_pose(*at(1.0))
    stage.add_embedding(embedding(1.0))
    with pytest.raises(RefusedInput) as refused:
        stage.adopt_model(ModelInfo('stub', 'cd' * 32, 2, {}))
    assert refused.value.cause == 'wrong_model'
    assert stage.map.model == MODEL


@pytest.mark.parametrize(('pause_s', 'gap_s'), [(0.1, 0.5), (0.3, 0.5), (0.5, 0.75), (1.0, 1.5), (5.0, 1.5)])
def test_positions_are_expected_while_they_arrive_and_a_scan_waits(
    session_map: SessionMap, clock: Clock, pause_s: float, gap_s: float
) -> None:
    """Of a slow receiver the next one takes longer."""
    stage = MapStage(CONFIG, session_map, clock)
    stage.add_pose(*at(1.0))
    assert not stage.expects_positions(stage.scans)
    stage.add_embedding(embedding(1.5))
    assert stage.expects_positions(stage.scans)
    clock.seconds += pause_s
    stage.add_pose(*at(1.25))
    clock.seconds += 0.9 * gap_s
    assert stage.expects_positions(stage.scans)
    clock.seconds += 0.2 * gap_s
    assert not stage.expects_positions(stage.scans)
    stage.add_pose(*at(2.0))
    assert not stage.expects_positions(stage.scans)


def test_a_running_session_is_saved_periodically(stored: MapStage, clock: Clock, tmp_path: Path) -> None:
    def on_disk() -> int:
        return len(MapStore.open_read_only(tmp_path / 'map.db').places)

    stored.adopt_model(MODEL)
    stored.add_pose(*at(1.0))
    stored.add_pose(*at(2.0))
    stored.add_embedding(embedding(1.0))
    clock.seconds += 9.9
    stored.autosave()
    assert on_disk() == 0
    clock.seconds += 0.2
    stored.autosave()
    assert on_disk() == 1
    stored.add_embedding(embedding(2.0))
    stored.autosave()
    assert on_disk() == 1
    stored.save()
    assert on_disk() == 2


def test_a_failed_autosave_is_reported_once_per_period(
    stored: MapStage, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def locked() -> None:
        raise MapError('map.db: locked')

    monkeypatch.setattr(stored.map, 'save', locked)
    for _ in range(2):
        clock.seconds += 10.0
        with pytest.raises(RefusedInput, match=r'map\.db: locked') as refused:
            stored.autosave()
        assert refused.value.cause == 'not_saved'
        stored.autosave()


def test_a_map_in_memory_is_not_saved(stage: MapStage) -> None:
    stage.autosave()
    with pytest.raises(MapError, match=r'map\.path is empty'):
        stage.save()


def test_a_session_without_scans_continues(stage: MapStage) -> None:
    assert stage.start_session(0) == 'session 1 runs already and is empty: it continues'
    stage.add_pose(*at(1.0))
    stage.add_embedding(embedding(1.0))
    with pytest.raises(MapError, match='runs: end it or undo it first'):
        stage.start_session(0)
    stage.end_session()
    assert stage.start_session(0) == 'session 2 started'


def mapped(stage: MapStage, *seconds: float) -> None:
    """Map one session of scans at these times."""
    stage.start_session(0)
    for each in seconds:
        stage.add_pose(*at(each))
        stage.add_embedding(embedding(each))
    stage.end_session()


def test_a_map_without_a_model_is_not_published(stored: MapStage) -> None:
    assert stored.committed() is None
    stored.adopt_model(MODEL)
    committed = stored.committed()
    assert committed is not None
    assert (committed.form, len(committed.table)) == (Form.WHOLE, 0)


def test_a_large_map_is_read_from_its_file_once_and_then_updated(
    stage: MapStage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_stage, 'MAX_MESSAGE_PLACES', 3)

    def published() -> tuple[Form, int]:
        committed = stage.committed()
        assert committed is not None
        return committed.form, len(committed.table)

    mapped(stage, 1.0, 2.0)
    assert published() == (Form.WHOLE, 2)
    mapped(stage, 3.0, 4.0)
    assert published() == (Form.FILE, 0)
    mapped(stage, 5.0)
    assert published() == (Form.CHANGES, 1)
    mapped(stage, 6.0, 7.0)
    assert published() == (Form.CHANGES, 2)
    # An undo is not sent as changes: the file is read again.
    stage.undo_session()
    assert published() == (Form.FILE, 0)
    stage.clear()
    assert published() == (Form.WHOLE, 0)
    mapped(stage, 8.0, 9.0, 10.0, 11.0)
    assert published() == (Form.FILE, 0)


def test_a_view_is_returned_only_after_changes(stage: MapStage, monkeypatch: pytest.MonkeyPatch) -> None:
    assert stage.changed_view() is None
    stage.add_pose(*at(1.0))
    stage.add_embedding(embedding(1.0))
    view = stage.changed_view()
    assert view is not None
    assert len(view) == 1
    assert stage.changed_view() is None
    # A scan of the same place, no more certain, changes nothing.
    stage.add_pose(*at(1.01))
    stage.add_embedding(embedding(1.01))
    assert stage.changed_view() is None
    monkeypatch.setattr(map_stage, 'MAX_MESSAGE_PLACES', 1)
    stage.add_pose(*at(5.0))
    stage.add_embedding(embedding(5.0))
    assert stage.changed_view() is None


FAR = GeoPoint(37.42, -122.08, 5.0)
"""Where the receiver was made, on another continent."""


def drive_point(seconds: float) -> GeoPoint:
    """A vehicle at 10 m/s northwards."""
    return GeoPoint(51.75 + 10.0 * seconds / 111_250, -1.25, 70.0)


def first_drive(stage: MapStage, wrong: Sequence[int], count: int = 40) -> None:
    """Two scans and two positions a second; those of the rows `wrong` are on another continent."""
    for k in range(count):
        stage.add_point(k * SECOND // 2, FAR if k in wrong else drive_point(k / 2))
        stage.add_embedding(embedding(k / 2))


def left_out(stage: MapStage) -> dict[str, int]:
    """Number of positions that do not count, by cause."""
    return {one.cause: one.count for one in stage.take_left_out()}


def handled(report: SessionReport) -> int:
    return report.inserted + report.replaced + report.kept + sum(report.dropped.values())


@pytest.mark.parametrize('wrong', [range(1), range(2), range(15), range(10, 12), range(20, 39)])
def test_the_origin_is_one_that_most_positions_agree_with(session_map: SessionMap, wrong: range) -> None:
    """Whatever comes first, and though scans were mapped around a wrong fix meanwhile."""
    stage = MapStage(CONFIG, session_map)
    first_drive(stage, wrong)
    _, report = stage.end_session()
    assert session_map.origin is not None
    assert session_map.origin.latitude_deg == pytest.approx(51.75, abs=0.01)
    places = session_map.places()
    assert np.abs(places.positions_m).max() < 1000.0
    assert handled(report) == 40
    assert report.inserted == len(places) >= 40 - len(wrong) - 4
    assert left_out(stage) == {'far_position': len(wrong)}


def test_what_was_mapped_around_a_wrong_fix_is_told_of_once(session_map: SessionMap) -> None:
    stage = MapStage(CONFIG, session_map)
    first_drive(stage, range(10), 19)
    assert not stage.take_discarded()
    assert len(session_map) == 1
    first_drive(stage, (), 0)
    stage.add_point(19 * SECOND // 2, drive_point(9.5))
    stage.add_point(20 * SECOND // 2, drive_point(10.0))
    assert stage.take_discarded()
    assert not stage.take_discarded()
    _, report = stage.end_session()
    assert report.dropped['far_position'] > 0


def test_an_origin_that_a_session_ended_with_stays(session_map: SessionMap) -> None:
    stage = MapStage(CONFIG, session_map)
    first_drive(stage, ())
    stage.end_session()
    origin = session_map.origin
    stage.start_session(0)
    for k in range(100):
        stage.add_point(20 * SECOND + k * SECOND // 2, FAR)
    (far,) = stage.take_left_out()
    assert (far.cause, far.count) == ('far_position', 100)
    assert 'km from the map' in far.first
    assert session_map.origin == origin


def test_a_spoilt_origin_is_told_of_with_the_remedy(tmp_path: Path) -> None:
    config = Config(position=CONFIG.position, map=MapConfig(path=str(tmp_path / 'a.map')))
    with SessionMap(config.map) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(config, session_map)
        stage.start_session(0)
        first_drive(stage, range(40))
        stage.end_session()
        assert stage.problem() == ''
    with SessionMap(config.map) as session_map:
        stage = MapStage(config, session_map)
        stage.start_session(0)
        first_drive(stage, ())
        assert left_out(stage) == {'far_position': 40}
        assert 'its origin was a wrong fix: undo its sessions or clear it' in stage.problem()
        assert '\n' not in stage.problem()
        stage.clear()
        assert stage.problem() == ''
        for k in range(40):
            stage.add_point((100 + k) * SECOND // 2, drive_point(k / 2))
            stage.add_embedding(embedding(50.0 + k / 2))
        _, report = stage.end_session()
        assert report.inserted > 0
        assert session_map.origin is not None
        assert session_map.origin.latitude_deg == pytest.approx(51.75, abs=0.01)


@pytest.mark.parametrize('how', ['full', 'removed'])
def test_a_wrong_origin_stays_until_what_lies_around_it_is_discarded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """Or else scans would be mapped in a frame that is not theirs."""
    path = tmp_path / 'town.db'
    config = Config(position=CONFIG.position, map=MapConfig(path=str(path)))

    def fail(*_: object) -> None:
        raise MapError('database or disk is full')

    with SessionMap(config.map) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(config, session_map)
        stage.start_session(0)
        first_drive(stage, range(4), 4)
        stage.save()
        with monkeypatch.context() as broken:
            if how == 'full':
                broken.setattr(MapStore, 'undo_session', fail)
            else:
                path.rename(tmp_path / 'away.db')
            for k in range(4, 20):
                stage.add_point(k * SECOND // 2, drive_point(k / 2))
                stage.add_embedding(embedding(k / 2))
            assert ('disk is full' if how == 'full' else 'file was removed') in stage.problem()
            assert len(session_map) == 1
            assert not stage.take_discarded()
            if how == 'removed':
                (tmp_path / 'away.db').rename(path)
        for k in range(20, 40):
            stage.add_point(k * SECOND // 2, drive_point(k / 2))
            stage.add_embedding(embedding(k / 2))
        assert stage.problem() == ''
        assert stage.take_discarded()
        _, report = stage.end_session()
        assert left_out(stage) == {'far_position': 4}
        assert handled(report) == 40
        places = session_map.places()
        assert len(places) == report.inserted > 15
        assert np.abs(places.positions_m).max() < 1000.0
    stored = MapStore.open_read_only(path)
    assert stored.origin is not None
    assert stored.origin.latitude_deg == pytest.approx(51.75, abs=0.01)


def north_of_the_edge(second: int) -> GeoPoint:
    """A vehicle at 90 m/s northwards for 105 km, and in a town there from then on."""
    north_m = 90.0 * second if second < 1166 else 105_000.0 + 500.0 * math.sin(second / 50.0)
    return GeoPoint(51.0 + north_m / 111_250, -1.25, 70.0)


def test_a_long_drive_keeps_its_map(session_map: SessionMap) -> None:
    """Though most of it is beyond the frame: that the vehicle has driven there shows that the origin is right."""
    stage = MapStage(CONFIG, session_map)
    for second in range(3000):
        stage.add_point(second * SECOND, north_of_the_edge(second))
        stage.add_embedding(embedding(float(second)))
    assert not stage.take_discarded()
    assert len(session_map) > 1000


def test_a_drive_out_of_the_frame_is_told_of_as_it_goes(session_map: SessionMap) -> None:
    stage = MapStage(CONFIG, session_map)
    for second in range(1200):
        stage.add_point(second * SECOND, north_of_the_edge(second))
    far = left_out(stage)['far_position']
    assert 0 < far < 100
    assert f'the last {far} positions are over 100 km from' in stage.problem()
    assert 'use another map.path' in stage.problem()
    for second in range(1200, 1210):
        stage.add_point((second + 3000) * SECOND, GeoPoint(51.5 + second / 111_250, -1.25, 70.0))
    stage.flush()
    assert stage.problem() == ''


def test_scans_that_one_position_resolves_are_answered_though_the_next_is_refused(session_map: SessionMap) -> None:
    """Positions after a gap are held; one of them is far from the map."""
    stage = MapStage(CONFIG, session_map)
    first_drive(stage, ())
    stage.end_session()
    stage.start_session(0)
    updates: list[MapUpdate] = []
    for second, point in ((50, 50.0), (51, 51.0), (52, None), (53, 53.0), (54, 54.0)):
        updates += stage.add_point(second * SECOND, FAR if point is None else drive_point(point))
        for quarter in range(4):
            updates += stage.add_embedding(embedding(second + 0.1 + quarter / 4))
    last, report = stage.end_session()
    assert len(updates) + len(last) == handled(report) == 20
    assert left_out(stage) == {'far_position': 1}


def test_every_position_is_counted_however_many_are_far(
    session_map: SessionMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('offradar_ros.stages.map_frame._MOST_HELD', 50)
    stage = MapStage(CONFIG, session_map)
    told = 0
    for k in range(201):
        stage.add_point(k * SECOND // 10, FAR if k < 100 else drive_point(k / 10))
        told += sum(left_out(stage).values())
    # Those around the wrong fix, and of the others the ones that were too many to hold.
    assert told == 100 + 51
    assert not stage.add_embedding(embedding(16.0))[0].problem


def test_far_positions_of_an_earlier_run_do_not_contradict_those_of_the_next(session_map: SessionMap) -> None:
    """A recording is played again before it is known which positions are right."""
    stage = MapStage(CONFIG, session_map)
    sent = 0
    for second in range(100, 106):
        stage.add_point(second * SECOND, FAR)
    for second in range(106, 110):
        stage.add_point(second * SECOND, drive_point(second))
    for second in range(1, 9):
        stage.add_point(second * SECOND, drive_point(second))
        for quarter in range(4):
            stage.add_embedding(embedding(second + quarter / 4))
            sent += 1
    _, report = stage.end_session()
    assert handled(report) == sent
    assert report.inserted > 20
    assert left_out(stage) == {'far_position': 10}


def test_positions_that_are_held_when_the_scans_start_again_are_counted(stage: MapStage) -> None:
    """One of a clock that is not set; then the recording is played again."""
    for second in range(100, 105):
        stage.add_pose(*at(float(second)))
        stage.add_embedding(embedding(float(second)))
    stage.add_pose(10**9 * SECOND, Pose(0.0, 0.0))
    stage.add_embedding(embedding(1.0))
    assert left_out(stage) == {'position_stamp_jump': 1}


def test_an_undo_that_cannot_be_written_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = Config(position=CONFIG.position, map=MapConfig(path=str(tmp_path / 'a.map')))
    with SessionMap(config.map) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(config, session_map)
        stage.start_session(0)
        first_drive(stage, ())
        stage.end_session()
        origin, places = session_map.origin, len(session_map)
        put_meta = SealedRows.put_meta

        def fail(rows: SealedRows, key: str, value: object) -> None:
            if key == 'origin':
                raise sqlite3.OperationalError('database or disk is full')
            put_meta(rows, key, value)

        with monkeypatch.context() as full:
            full.setattr(SealedRows, 'put_meta', fail)
            for forget in (stage.undo_session, stage.clear):
                with pytest.raises(MapError, match='disk is full'):
                    forget()
                assert (session_map.origin, len(session_map)) == (origin, places)
        stored = MapStore.open_read_only(tmp_path / 'a.map')
        assert (stored.origin, len(stored.places)) == (origin, places)


def test_a_model_that_cannot_be_written_is_not_another_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is sent once, so the map server tries it again, and only where there is no space."""
    config = Config(position=CONFIG.position, map=MapConfig(path=str(tmp_path / 'a.map')))

    def fail(*_: object, **__: object) -> None:
        raise MapError('database or disk is full')

    with SessionMap(config.map) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(config, session_map)
        monkeypatch.setattr(MapStore, 'write_model', fail)
        with pytest.raises(RefusedInput) as refused:
            stage.adopt_model(ModelInfo('stub', 'cd' * 32, 2, {}))
    assert refused.value.cause == 'not_saved'


def test_scans_that_wait_for_a_model_are_told_of_though_the_end_cannot_be_written(stored: MapStage) -> None:
    stored.add_embedding(embedding(1.0))
    assert brief(stored.flush()) == [(1.0, 'no_model')]


def test_an_origin_at_zero_is_told_of_at_once() -> None:
    with SessionMap(MapConfig()) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('of an earlier version', 0)
        session_map.set_origin(GeoPoint(0.0, 0.0, 0.0))
        stage = MapStage(CONFIG, session_map)
        assert "the map's origin is 0°, 0°" in stage.problem()


@pytest.mark.parametrize('in_file', [False, True])
@pytest.mark.parametrize('forget', [MapStage.undo_session, MapStage.clear])
def test_a_map_without_places_has_no_origin(
    tmp_path: Path, forget: Callable[[MapStage], object], in_file: bool
) -> None:
    config = Config(position=CONFIG.position, map=MapConfig(path=str(tmp_path / 'a.map') if in_file else ''))
    with SessionMap(config.map) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(config, session_map)
        stage.start_session(0)
        first_drive(stage, range(40))
        stage.end_session()
        assert session_map.origin is not None
        forget(stage)
        assert session_map.origin is None
    if in_file:
        with SessionMap(config.map) as session_map:
            assert session_map.origin is None


def test_an_origin_stays_while_a_session_can_be_undone_that_has_places(session_map: SessionMap) -> None:
    stage = MapStage(CONFIG, session_map)
    first_drive(stage, ())
    stage.end_session()
    origin = session_map.origin
    stage.start_session(0)
    stage.add_point(100 * SECOND, drive_point(100.0))
    stage.add_embedding(embedding(100.0))
    stage.end_session()
    stage.undo_session()
    assert session_map.origin == origin


def test_positions_that_are_none_never_reach_the_map(stage: MapStage) -> None:
    for point in (GeoPoint(0.0, 0.0), GeoPoint(90.0, 0.0)):
        with pytest.raises(RefusedInput):
            stage.add_point(SECOND, point)
    for pose in (Pose(math.nan, 0.0), Pose(1e10, 0.0), Pose(0.0, 0.0, math.inf)):
        with pytest.raises(RefusedInput):
            stage.add_pose(SECOND, pose)
    with pytest.raises(RefusedInput) as refused:
        stage.add_pose(-SECOND, Pose(0.0, 0.0))
    assert refused.value.cause == 'invalid_stamp'


def test_an_embedding_that_is_never_merged_does_not_wait(stage: MapStage) -> None:
    stage.add_pose(*at(1.0))
    hostile = [
        embedding(1e9, model='cd' * 32),
        embedding(1e9, dimension=3),
        dataclasses.replace(embedding(1e9), mean=np.full(2, np.nan, np.float32)),
        dataclasses.replace(embedding(1e9), mean=np.full(2, 1e36, np.float32)),
        embedding(-1.0),
        embedding(2.0**31),
    ]
    causes = [cause for bad in hostile for _, cause in brief(stage.add_embedding(bad))]
    assert causes == ['wrong_model', *['invalid_embedding'] * 5]
    # Their stamps do not make a sound scan one of an earlier recording.
    assert brief(stage.add_embedding(embedding(1.25))) == []
    assert brief(stage.add_embedding(embedding(1e9, model='cd' * 32))) == [(1e9, 'wrong_model')]
    assert brief(stage.add_pose(*at(1.5))) == [(1.25, 12.5)]


def test_scans_of_one_stamp_do_not_fill_the_memory(stage: MapStage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('offradar_ros.mapping.pending.MAX_WAITING', 10)
    refused = [one for _ in range(50) for one in brief(stage.add_embedding(embedding(1.25)))]
    assert refused == [(1.25, 'too_many_waiting')] * 40


def test_a_model_of_another_dimension_is_refused_as_another_model(stage: MapStage) -> None:
    stage.add_pose(*at(1.0))
    stage.add_embedding(embedding(1.0))
    with pytest.raises(RefusedInput, match='d = 2, not 3') as refused:
        stage.adopt_model(dataclasses.replace(MODEL, dimension=3))
    assert refused.value.cause == 'wrong_model'


@pytest.mark.parametrize('altitude_m', [1e308, -1e308, 1e6])
def test_an_altitude_that_is_none_never_becomes_that_of_the_origin(altitude_m: float) -> None:
    with pytest.raises(RefusedInput, match='not on the Earth') as refused:
        GeoPoint(51.75, -1.25, altitude_m)
    assert refused.value.cause == 'invalid_position'


def test_a_scan_is_not_mapped_towards_a_position_that_jumps(stage: MapStage) -> None:
    """Scans beside it get their position from those around it."""
    updates: list[MapUpdate] = []
    for k in range(80):
        stamp_ns = k * SECOND // 10
        if k % 2:
            updates += stage.add_embedding(embedding((k + 0.5) / 10))
        updates += stage.add_pose(stamp_ns, Pose(500.0 if k == 40 else 0.0, 0.8 * k))
    assert left_out(stage) == {'position_jump': 1}
    assert np.abs(stage.map.places().positions_m[:, 0]).max() < 1e-6
    stage.flush()
    assert not [update for update in updates if update.problem]


def test_nothing_is_mapped_between_both_sides_of_a_jump_that_lasts(stage: MapStage) -> None:
    for k in range(120):
        stage.add_embedding(embedding((k + 0.5) / 10))
        stage.add_pose(k * SECOND // 10, Pose(500.0 if k > 40 else 0.0, 0.8 * k))
    stage.flush()
    assert set(np.round(stage.map.places().positions_m[:, 0], 6).tolist()) == {0.0, 500.0}


def test_scans_that_come_later_do_not_keep_a_session_from_its_end(session_map: SessionMap, clock: Clock) -> None:
    """Where positions arrive later than the next scan, one always waits."""
    stage = MapStage(CONFIG, session_map, clock)
    stage.add_pose(*at(1.0))
    stage.add_embedding(embedding(1.5))
    asked = stage.scans
    stage.add_embedding(embedding(1.75))
    assert stage.expects_positions(asked)
    stage.add_pose(*at(1.625))
    assert not stage.expects_positions(asked)
    assert stage.expects_positions(stage.scans)


def test_a_first_drive_is_mapped_though_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / 'town.db'
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(MODEL)
        stage = MapStage(CONFIG, session_map)
        session_map.start_session('first', 0)

        def fail(*_: object, **__: object) -> None:
            raise MapError('database or disk is full')

        with monkeypatch.context() as full:
            full.setattr(MapStore, 'write_session', fail)
            stage.add_embedding(embedding(1.5))
            for second in (1, 2):
                stage.add_point(second * SECOND, GeoPoint(51.75, -1.25, 70.0))
            with pytest.raises(MapError, match='disk is full'):
                stage.end_session()
        _, report = stage.end_session()
    assert (report.inserted, dict(report.dropped)) == (1, {})
    stored = MapStore.open_read_only(path)
    assert stored.origin == GeoPoint(51.75, -1.25, 70.0)
    assert len(stored.places) == 1


# Headings


def curve(seconds: float, yaw_rad: float = math.nan) -> tuple[int, Pose]:
    """A vehicle that goes round a circle of 50 m at 10 m/s, and heads east at 0 s."""
    turned = 0.2 * seconds
    where = 50.0 * math.sin(turned), 50.0 * (1.0 - math.cos(turned))
    return round(seconds * SECOND), Pose(*where, 0.0, yaw_rad)


def headings_deg(stage: MapStage) -> list[float]:
    """Error of the heading of each place on the circle."""
    places = stage.map.places()
    errors: list[float] = np.abs(np.degrees(wrap_angle(places.yaws_rad - 0.2 * places.stamps_ns / SECOND))).tolist()
    return errors


def drive_round(stage: MapStage, *, late_s: float = 0.0, yaw_rad: float | None = math.nan) -> list[MapUpdate]:
    """Scans at 4 Hz and positions at 5 Hz, later than their scans by `late_s`, for 20 s."""
    scans = [(0.25 * k + 0.05, 'scan') for k in range(80)]
    positions = [(0.2 * k, 'position') for k in range(101)]
    updates: list[MapUpdate] = []
    for seconds, kind in sorted([*scans, *positions], key=lambda item: item[0] + (item[1] == 'position') * late_s):
        if kind == 'scan':
            updates += stage.add_embedding(embedding(seconds))
        else:
            measured = math.remainder(0.2 * seconds, math.tau) if yaw_rad is None else yaw_rad
            updates += stage.add_pose(*curve(seconds, measured))
    return updates + stage.flush()


def of_headings(choice: str, wait_s: float = 10.0) -> Config:
    return Config(position=PositionConfig(heading=choice, wait_s=wait_s))


@pytest.mark.parametrize('late_s', [0.0, 0.3, 3.0])
@pytest.mark.parametrize('yaw_rad', [math.nan, 0.0, None], ids=['unknown', 'identity', 'measured'])
def test_places_have_a_heading(session_map: SessionMap, late_s: float, yaw_rad: float | None) -> None:
    stage = MapStage(of_headings('auto'), session_map)
    updates = drive_round(stage, late_s=late_s, yaw_rad=yaw_rad)
    assert [update.stamp_ns for update in updates] == [embedding(0.25 * k + 0.05).stamp_ns for k in range(80)]
    assert not [update for update in updates if update.problem]
    assert len(session_map) == 80
    assert max(headings_deg(stage)) < 1.0
    sds_rad = session_map.places().yaw_sds_rad
    # Measured ones do not say how certain they are; the first scans still have their heading from the course.
    assert np.isfinite(sds_rad).all() if yaw_rad is not None else np.isnan(sds_rad[10:]).all()
    assert bool(stage.heading_problem()) == (yaw_rad == 0.0)


@pytest.mark.parametrize('wait_s', [0.0, 1.0, 2.5])
def test_a_heading_that_is_not_known_yet_costs_no_scan(session_map: SessionMap, wait_s: float) -> None:
    waits, stays = (
        MapStage(of_headings('auto', wait_s), session_map),
        MapStage(of_headings('none', wait_s), session_map),
    )
    counts = []
    for stage in (stays, waits):
        counts.append(sum(update.problem is None for update in drive_round(stage)))
        session_map.restart_session('again')
    assert counts[0] == counts[1]


@pytest.mark.parametrize(('choice', 'expected'), [('none', math.nan), ('source', 0.7), ('course', None)])
def test_the_choice_of_headings_is_kept_to(session_map: SessionMap, choice: str, expected: float | None) -> None:
    stage = MapStage(of_headings(choice), session_map)
    drive_round(stage, yaw_rad=0.7)
    yaws = session_map.places().yaws_rad
    assert stage.heading_problem() == ''
    if expected is None:
        assert max(headings_deg(stage)) < 1.0
    else:
        np.testing.assert_allclose(yaws, expected, atol=1e-12)


def test_headings_do_not_depend_on_when_positions_come(session_map: SessionMap) -> None:
    found = []
    for late_s in (-4.0, 0.0, 0.7, 5.0):
        drive_round(MapStage(of_headings('auto'), session_map), late_s=late_s)
        found.append(session_map.places().yaws_rad.tobytes())
        session_map.restart_session('again')
    assert len(set(found)) == 1


def test_scans_that_wait_for_a_heading_are_mapped_where_the_recording_starts_again(session_map: SessionMap) -> None:
    stage = MapStage(of_headings('auto'), session_map)
    updates: list[MapUpdate] = []
    for start_s in (100.0, 50.0):
        for k in range(30):
            updates += stage.add_pose(*at(start_s + 0.1 * k))
        updates += stage.add_embedding(embedding(start_s + 2.55))
    updates += stage.flush()
    assert np.array(brief(updates)) == pytest.approx(np.array([(102.55, 1025.5), (52.55, 525.5)]))


def test_a_session_waits_for_the_positions_that_tell_a_heading(session_map: SessionMap, clock: Clock) -> None:
    stage = MapStage(of_headings('auto'), session_map, clock)
    for k in range(60):
        clock.seconds = 0.1 * k
        stage.add_pose(*at(0.1 * k))
    stage.add_embedding(embedding(5.75))
    assert stage.expects_positions(stage.scans)
    for k in range(60, 79):
        clock.seconds = 0.1 * k
        stage.add_pose(*at(0.1 * k))
    assert stage.expects_positions(stage.scans)
    assert np.array(brief(stage.add_pose(*at(8.0)))) == pytest.approx(np.array([(5.75, 57.5)]))
    assert not stage.expects_positions(stage.scans)


def test_an_update_has_the_signature_of_its_scan_and_the_map_has_it_too(stage: MapStage) -> None:
    signed = dataclasses.replace(embedding(1.0), signature=b'signed')
    stage.add_pose(*at(0.5))
    stage.add_embedding(signed)
    (update,) = stage.add_pose(*at(1.5))
    (scan,) = update.changed.scans()
    assert (update.signature, update.changed.stamps_ns.tolist()) == (b'signed', [SECOND])
    unknown = ScanKey(scan.session_id, 7)
    assert stage.signatures([unknown, scan]) == {unknown: b'', scan: b'signed'}


def test_the_committed_map_tells_the_signatures_by_their_checksums(stage: MapStage) -> None:
    stage.add_pose(*at(0.5))
    for seconds, signature in ((1.0, b'signed'), (2.0, b'')):
        stage.add_embedding(dataclasses.replace(embedding(seconds), signature=signature))
    stage.add_pose(*at(1.5))
    stage.add_pose(*at(2.5))
    stage.end_session()
    committed = stage.committed()
    assert committed is not None
    assert committed.checksums == (checksum_of(b'signed'), 0)
