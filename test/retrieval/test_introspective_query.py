"""Every embedding is answered once: with a match, or with the first reason that holds."""

import dataclasses
import math

import numpy as np
import pytest

from offradar_ros.config import MapConfig, QueryConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.retrieval import introspective_query
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.types import Embedding, Match, Place, PlaceTable, Pose, Reason, Rejection

MODEL, OTHER = 'a' * 64, 'b' * 64


def places(*entries, session=1) -> PlaceTable:
    """Places (id, mean) of dimension 2."""
    made = [Place(i, session, i, Pose(i * 1.0, 0.0), 0.9, np.asarray(mean, np.float32)) for i, mean in entries]
    return PlaceTable.from_places(made, 2)


def scan(mean=(0.0, 0.0), uncertainty=1.0, model=MODEL, stamp=5) -> Embedding:
    return Embedding(stamp, np.asarray(mean, np.float32), np.full(len(mean), uncertainty, np.float32), model)


@pytest.fixture
def searching() -> IntrospectiveQuery:
    query = IntrospectiveQuery(QueryConfig(top_k=2, delta=0.5, levels=10, level=10))
    query.load(places((1, (3, 4)), (2, (0, 1)), (3, (10, 0))), MODEL)
    return query


def ids(outcome) -> list:
    return [candidate.place_id for candidate in outcome.candidates]


def test_a_match_holds_the_nearest_places_in_order(searching):
    outcome = searching.query(scan())
    assert isinstance(outcome, Match)
    assert ids(outcome) == [2, 1]
    assert [c.distance for c in outcome.candidates] == [1.0, 5.0]
    assert (outcome.stamp_ns, outcome.uncertainty, outcome.threshold) == (5, 1.0, 1.5)


@pytest.mark.parametrize(('uncertainty', 'accepted'), [(1.5, True), (1.5001, False), (0.0, True), (100.0, False)])
def test_above_the_threshold_it_is_uncertain_with_the_candidates_it_would_have_returned(
    searching, uncertainty, accepted
):
    outcome = searching.query(scan(uncertainty=uncertainty))
    assert isinstance(outcome, Match) == accepted
    assert ids(outcome) == [2, 1]
    if not accepted:
        assert outcome.reason is Reason.UNCERTAIN
        assert '1.5' in outcome.detail


def test_too_far_from_every_place_it_is_unknown(searching):
    far = scan((500.0, 0.0))
    assert isinstance(searching.query(far), Match)
    searching.reconfigure(dataclasses.replace(searching.config, max_distance=20.0))
    outcome = searching.query(far)
    assert isinstance(outcome, Rejection) and outcome.reason is Reason.UNKNOWN_PLACE
    assert ids(outcome) == [3, 1] and '490' in outcome.detail and '20' in outcome.detail
    assert isinstance(searching.query(scan((10.0, 20.0))), Match)


def test_thresholds_change_while_it_runs(searching):
    searching.reconfigure(dataclasses.replace(searching.config, level=0))
    outcome = searching.query(scan(uncertainty=0.6))
    assert isinstance(outcome, Rejection) and outcome.threshold == 0.5
    searching.reconfigure(dataclasses.replace(searching.config, level=1, top_k=3))
    assert ids(searching.query(scan(uncertainty=0.55))) == [2, 1, 3]


@pytest.mark.parametrize(
    'embedding',
    [
        scan((math.nan, 0.0)),
        scan((0.0, math.inf)),
        scan(uncertainty=math.nan),
        scan(uncertainty=-0.5),
        scan(()),
        Embedding(5, np.zeros(2, np.float32), np.ones(3, np.float32), MODEL),
    ],
)
def test_an_invalid_embedding_has_no_uncertainty(searching, embedding):
    outcome = searching.query(embedding)
    assert isinstance(outcome, Rejection) and outcome.reason is Reason.INVALID_EMBEDDING
    assert math.isnan(outcome.uncertainty) and outcome.candidates == ()
    assert outcome.stamp_ns == 5 and outcome.detail and '\n' not in outcome.detail


def test_another_model_or_dimension_is_never_compared(searching):
    outcome = searching.query(scan(model=OTHER))
    assert outcome.reason is Reason.WRONG_MODEL and outcome.candidates == ()
    assert 'bbbb' in outcome.detail and 'aaaa' in outcome.detail
    outcome = searching.query(scan((0.0, 0.0, 0.0)))
    assert outcome.reason is Reason.WRONG_MODEL and 'dimension 3, the map has 2' in outcome.detail


def test_thresholds_of_another_model_are_never_used(searching):
    searching.reconfigure(dataclasses.replace(searching.config, model=MODEL))
    assert isinstance(searching.query(scan()), Match)
    searching.reconfigure(dataclasses.replace(searching.config, model=OTHER))
    outcome = searching.query(scan())
    assert outcome.reason is Reason.WRONG_MODEL and outcome.candidates == () and outcome.uncertainty == 1.0
    assert 'model aaaaaaaaaaaa' in outcome.detail and 'calibrated for model bbbbbbbbbbbb' in outcome.detail
    assert searching.query(scan(model='')).detail.startswith('made by model (none)')
    assert searching.query(scan((math.nan, 0.0))).reason is Reason.INVALID_EMBEDDING
    searching.load(places(), '')
    assert searching.query(scan()).reason is Reason.WRONG_MODEL
    assert searching.query(scan(model=OTHER)).reason is Reason.MAP_EMPTY


def test_the_first_reason_in_order_counts(searching):
    searching.reconfigure(dataclasses.replace(searching.config, level=0, max_distance=1.0))
    assert searching.query(scan((math.nan, 9e9), model=OTHER)).reason is Reason.INVALID_EMBEDDING
    assert searching.query(scan((0.0, 9e9), 2.0, model=OTHER)).reason is Reason.WRONG_MODEL
    assert searching.query(scan((0.0, 9e9), 2.0)).reason is Reason.UNCERTAIN
    searching.load(places(), MODEL)
    assert searching.query(scan((0.0, 9e9), 2.0, model=OTHER)).reason is Reason.WRONG_MODEL
    assert searching.query(scan((0.0, 9e9), 2.0)).reason is Reason.MAP_EMPTY


def test_without_a_map_there_is_nothing_to_search_until_the_first_places_come():
    query = IntrospectiveQuery(QueryConfig())
    assert query.query(scan()).reason is Reason.MAP_EMPTY
    # An empty map that came as a message tells of no model.
    query.load(places(), '')
    assert query.query(scan(model=OTHER)).reason is Reason.MAP_EMPTY
    query.update(places((1, (0, 0))), MODEL, committed=True)
    assert isinstance(query.query(scan()), Match)


def test_places_of_another_model_are_refused(searching):
    for committed in (True, False):
        with pytest.raises(RefusedInput) as refused:
            searching.update(places((1, (0, 0))), OTHER, committed=committed)
        assert refused.value.cause == 'wrong_model'
    assert ids(searching.query(scan())) == [2, 1]


def test_the_running_session_s_places_are_found_only_if_asked(searching):
    searching.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    assert ids(searching.query(scan(stamp=100))) == [2, 1]
    searching.reconfigure(dataclasses.replace(searching.config, exclude_current_session=False, top_k=4))
    outcome = searching.query(scan(stamp=100))
    # Place 2 counts once, as the running session left it.
    assert ids(outcome) == [7, 1, 2, 3]
    assert outcome.candidates[2].distance == 8.0
    searching.reconfigure(dataclasses.replace(searching.config, exclude_current_session=True))
    assert [c.distance for c in searching.query(scan()).candidates] == [1.0, 5.0, 10.0]


def test_a_scan_never_finds_itself(searching):
    searching.reconfigure(dataclasses.replace(searching.config, exclude_current_session=False, top_k=4))
    searching.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    # Place 2 holds the scan of stamp 2 and place 7 that of stamp 7: a scan finds what was mapped before it, whether
    # its own row came before it or comes after.
    as_before = [(2, 1.0), (1, 5.0), (3, 10.0)]
    for stamp in (2, 7):
        assert [(c.place_id, c.distance) for c in searching.query(scan(stamp=stamp)).candidates] == as_before
    assert ids(searching.query(scan(stamp=8))) == [7, 1, 2, 3]
    # The recording again, in the same session: the places that hold this very scan are as they were.
    assert ids(searching.query(scan(stamp=7))) == [1, 2, 3]


def test_rows_of_the_running_session_are_not_held_for_ever(searching):
    searching.reconfigure(dataclasses.replace(searching.config, exclude_current_session=False, top_k=1))
    for i in range(200):
        searching.update(places((1000 + i, (0.5, 0)), session=2), MODEL, committed=False)
    searching.query(scan(stamp=1))
    assert len(searching._arrived) <= 64


def test_once_committed_they_are_found_always(searching):
    searching.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    searching.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=True)
    assert searching.places == 4
    for exclude in (True, False):
        searching.reconfigure(dataclasses.replace(searching.config, exclude_current_session=exclude, top_k=4))
        assert ids(searching.query(scan())) == [7, 1, 2, 3]


def test_a_session_s_first_places_answer_in_an_empty_map_if_asked():
    query = IntrospectiveQuery(QueryConfig(exclude_current_session=False))
    query.load(places(), MODEL)
    query.update(places((1, (0, 0))), MODEL, committed=False)
    assert isinstance(query.query(scan(stamp=100)), Match)
    query.reconfigure(QueryConfig())
    assert query.query(scan()).reason is Reason.MAP_EMPTY


def test_loading_replaces_everything(searching):
    searching.update(places((9, (0, 0))), MODEL, committed=False)
    searching.load(places((4, (1, 1))), OTHER)
    searching.reconfigure(dataclasses.replace(searching.config, exclude_current_session=False))
    assert ids(searching.query(scan(model=OTHER))) == [4]
    assert searching.query(scan()).reason is Reason.WRONG_MODEL


def test_refused_places_leave_the_map_as_it_was(searching):
    for committed in (True, False):
        with pytest.raises(RefusedInput):
            searching.update(places((2, (math.nan, 0))), MODEL, committed=committed)
    assert ids(searching.query(scan())) == [2, 1]


def stored_map(path, count=3000, running=True) -> SessionMap:
    """A map of more than a batch of places; a session that goes on has replaced some and added others."""
    session_map = SessionMap(MapConfig(path=str(path)))
    session_map.adopt_model(ModelInfo('ring_key', MODEL, 2, {}))
    session_map.start_session('first', 1)
    for i in range(count):
        session_map.merge(scan((i % 60, i // 60), stamp=i), Pose(10.0 * i, 0.0, 0.0, 0.5))
    session_map.end_session()
    if running:
        session_map.start_session('second', 2)
        for i in range(count - 5, count + 5):
            session_map.merge(scan((-3.0, -i), 0.5, stamp=count + i), Pose(10.0 * i, 0.0, 0.0, 0.5))
        session_map.save()
    return session_map


@pytest.mark.parametrize('storage', ['float32', 'float16'])
@pytest.mark.parametrize('running', [False, True])
def test_a_file_is_searched_as_the_table_of_its_ended_sessions(tmp_path, storage, running):
    path = tmp_path / 'a.map'
    config = QueryConfig(top_k=7, storage=storage)
    from_file, from_table = IntrospectiveQuery(config), IntrospectiveQuery(config)
    with stored_map(path, running=running) as session_map:
        from_file.load_file(path)
        from_table.load(session_map.committed(), MODEL)
    assert from_file.places == from_table.places == 3000
    for mean in ((0.0, 0.0), (-3.0, -2997.0), (59.0, 49.0), (30.2, 25.7)):
        assert from_file.query(scan(mean)) == from_table.query(scan(mean))


def test_a_file_is_read_again_only_if_it_was_written_or_is_not_what_is_searched(tmp_path, monkeypatch):
    path = tmp_path / 'a.map'
    reads = []
    read = introspective_query.read_committed
    monkeypatch.setattr(introspective_query, 'read_committed', lambda *given: reads.append(path) or read(*given))
    stored_map(path, count=3, running=False).close()
    query = IntrospectiveQuery(QueryConfig(exclude_current_session=False))

    def read_anew() -> int:
        reads.clear()
        query.load_file(path)
        return len(reads)

    assert read_anew() == 1
    with SessionMap(MapConfig(path=str(path))) as session_map:
        query.update(places((7, (100, 100)), session=2), MODEL, committed=False)
        assert query.query(scan((100, 100), stamp=8)).candidates[0].place_id == 7
        assert read_anew() == 0
        # The server says so when a session is over: what it had changed is none of the map's.
        assert query.query(scan((100, 100), stamp=8)).candidates[0].place_id == 2
        session_map.start_session('second', 2)
        session_map.merge(scan((1.0, 1.0), stamp=9), Pose(500.0, 0.0))
        session_map.end_session()
        assert (read_anew(), query.places) == (1, 4)
        assert read_anew() == 0
        session_map.undo_session()
        assert (read_anew(), query.places) == (1, 3)
    query.update(places((7, (100, 100))), MODEL, committed=True)
    assert (read_anew(), query.places) == (1, 3)
    query.load(places((1, (3, 4))), MODEL)
    assert (read_anew(), query.places) == (1, 3)


def test_an_unreadable_file_leaves_what_is_searched(tmp_path, searching):
    (tmp_path / 'a.map').write_text('no map')
    with pytest.raises(MapError, match=r'a\.map'):
        searching.load_file(tmp_path / 'a.map')
    assert ids(searching.query(scan())) == [2, 1]


def test_a_file_of_values_that_float16_cannot_keep_is_refused_by_its_name(tmp_path):
    path = tmp_path / 'a.map'
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(ModelInfo('ring_key', MODEL, 2, {}))
        session_map.start_session('first', 1)
        session_map.merge(scan((1e5, 0.0)), Pose(0.0, 0.0))
        session_map.end_session()
    with pytest.raises(MapError, match=r'a\.map: place 0: .*query\.storage: float16') as refused:
        IntrospectiveQuery(QueryConfig(storage='float16')).load_file(path)
    assert 'damaged' not in str(refused.value)
    IntrospectiveQuery(QueryConfig()).load_file(path)


def test_every_way_into_the_index_rounds_alike():
    query = IntrospectiveQuery(QueryConfig(storage='float16', exclude_current_session=False, top_k=3))
    third = 1.0 / 3.0
    query.load(places((1, (third, 0))), MODEL)
    query.update(places((2, (third, 0))), MODEL, committed=True)
    query.update(places((3, (third, 0))), MODEL, committed=False)
    outcome = query.query(scan((third, 0.0), stamp=9))
    assert ids(outcome) == [1, 2, 3]
    expected = abs(float(np.float16(third)) - float(np.float32(third)))
    assert [c.distance for c in outcome.candidates] == [pytest.approx(expected, rel=1e-6)] * 3
