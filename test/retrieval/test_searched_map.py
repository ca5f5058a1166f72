"""Searches find ended sessions always, the running one if requested, and never the scan itself."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.config import MapConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.mapping.map_reader import read_committed
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.retrieval import searched_map
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Candidate, Embedding, Place, PlaceTable, Pose, ScanKey

MODEL, OTHER = 'a' * 64, 'b' * 64


def places(*entries: tuple[int, tuple[float, float]], session: int = 1) -> PlaceTable:
    """Places (id, mean) of dimension 2."""
    made = [Place(i, session, i, Pose(i * 1.0, 0.0), 0.9, np.asarray(mean, np.float32)) for i, mean in entries]
    return PlaceTable.from_places(made, 2)


def scan(mean: tuple[float, ...] = (0.0, 0.0), uncertainty: float = 1.0, stamp: int = 5) -> Embedding:
    return Embedding(stamp, np.asarray(mean, np.float32), np.full(len(mean), uncertainty, np.float32), MODEL)


@pytest.fixture
def searched() -> SearchedMap:
    loaded = SearchedMap()
    loaded.load(places((1, (3, 4)), (2, (0, 1)), (3, (10, 0))), MODEL)
    return loaded


def ids(candidates: tuple[Candidate, ...]) -> list[int]:
    return [candidate.place_id for candidate in candidates]


def found(searched: SearchedMap, stamp: int, k: int = 4) -> list[tuple[int, float]]:
    """Ids and distances that a scan of this stamp finds, with the running session."""
    candidates = searched.nearest(scan(stamp=stamp), k, include_running=True)
    return [(candidate.place_id, candidate.distance) for candidate in candidates]


def test_the_first_places_set_the_model() -> None:
    searched = SearchedMap()
    assert (len(searched), searched.model, searched.dimension) == (0, '', 0)
    assert searched.nearest(scan(), 3) == ()
    searched.update(places((1, (0, 0))), MODEL, committed=True)
    assert (len(searched), searched.model, searched.dimension) == (1, MODEL, 2)


def test_places_of_another_model_are_refused(searched: SearchedMap) -> None:
    for committed in (True, False):
        with pytest.raises(RefusedInput) as refused:
            searched.update(places((1, (0, 0))), OTHER, committed=committed)
        assert refused.value.cause == 'wrong_model'
    assert ids(searched.nearest(scan(), 2)) == [2, 1]


def test_places_of_the_running_session_are_found_only_if_requested(searched: SearchedMap) -> None:
    searched.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    assert ids(searched.nearest(scan(stamp=100), 2)) == [2, 1]
    # Place 2 is found once, with the content of the running session.
    assert found(searched, 100) == [(7, 0.5), (1, 5.0), (2, 8.0), (3, 10.0)]
    assert [c.distance for c in searched.nearest(scan(), 4)] == [1.0, 5.0, 10.0]


def test_a_scan_never_finds_itself(searched: SearchedMap) -> None:
    searched.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    # Place 2 holds the scan of stamp 2 and place 7 that of stamp 7: a scan finds what was mapped before it, whether the
    # update with its own row arrives before or after the query.
    for stamp in (2, 7):
        assert found(searched, stamp) == [(2, 1.0), (1, 5.0), (3, 10.0)]
    assert [place_id for place_id, _ in found(searched, 8)] == [7, 1, 2, 3]
    # The same recording again, in the same session: places that hold this scan count with their committed content.
    assert [place_id for place_id, _ in found(searched, 7)] == [1, 2, 3]


def scans(searched: SearchedMap, stamp: int, *, include_running: bool) -> dict[int, ScanKey]:
    """By place, the scan that a scan of this stamp is compared with."""
    search = searched.around(scan(stamp=stamp), include_running=include_running)
    return {candidate.place_id: search.scan_of(candidate) for candidate in search.nearest(9)}


def test_the_scan_of_a_candidate_is_the_one_that_was_compared(searched: SearchedMap) -> None:
    committed = {1: ScanKey(1, 1), 2: ScanKey(1, 2), 3: ScanKey(1, 3)}
    assert scans(searched, 100, include_running=True) == committed
    searched.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    assert scans(searched, 100, include_running=False) == committed
    assert scans(searched, 100, include_running=True) == committed | {2: ScanKey(2, 2), 7: ScanKey(2, 7)}
    # A place that holds this scan itself counts with its committed content.
    assert scans(searched, 2, include_running=True) == committed | {7: ScanKey(2, 7)}
    searched.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=True)
    assert scans(searched, 2, include_running=False) == committed | {2: ScanKey(2, 2), 7: ScanKey(2, 7)}


def test_the_number_of_waiting_updates_is_bounded(searched: SearchedMap) -> None:
    for i in range(200):
        searched.update(places((1000 + i, (0.5, 0)), session=2), MODEL, committed=False)
    # All of them are newer than this scan.
    held = len(found(searched, 1, k=1000)) - len(searched)
    assert held == 200 - searched_map.MAX_WAITING_UPDATES


def test_committed_places_are_always_found(searched: SearchedMap) -> None:
    searched.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=False)
    searched.update(places((2, (8, 0)), (7, (0.5, 0)), session=2), MODEL, committed=True)
    assert len(searched) == 4
    for include_running in (False, True):
        assert ids(searched.nearest(scan(), 4, include_running=include_running)) == [7, 1, 2, 3]


def test_places_of_the_first_session_are_found_if_requested() -> None:
    searched = SearchedMap()
    searched.load(places(), MODEL)
    searched.update(places((1, (0, 0))), MODEL, committed=False)
    assert found(searched, 100) == [(1, 0.0)]
    assert searched.nearest(scan(), 4) == ()


def test_loading_replaces_everything(searched: SearchedMap) -> None:
    searched.update(places((9, (0, 0))), MODEL, committed=False)
    searched.load(places((4, (1, 1))), OTHER)
    assert searched.model == OTHER
    assert [place_id for place_id, _ in found(searched, 100)] == [4]


def test_refused_places_leave_the_map_unchanged(searched: SearchedMap) -> None:
    for committed in (True, False):
        with pytest.raises(RefusedInput):
            searched.update(places((2, (np.nan, 0))), MODEL, committed=committed)
    with pytest.raises(RefusedInput):
        searched.load(places((2, (np.nan, 0))), OTHER)
    assert ids(searched.nearest(scan(), 2)) == [2, 1]


def stored_map(path: Path, count: int = 3000, running: bool = True) -> SessionMap:
    """A map with more places than a batch; with `running`, a session that replaced some and added others."""
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


@pytest.mark.parametrize('running', [False, True])
def test_a_file_and_the_table_of_its_ended_sessions_give_the_same_answers(tmp_path: Path, running: bool) -> None:
    path = tmp_path / 'a.map'
    from_file, from_table = SearchedMap(), SearchedMap()
    with stored_map(path, running=running) as session_map:
        from_file.load_file(path)
        from_table.load(session_map.committed(), MODEL)
    assert len(from_file) == len(from_table) == 3000
    assert from_file.model == MODEL
    for mean in ((0.0, 0.0), (-3.0, -2997.0), (59.0, 49.0), (30.2, 25.7)):
        assert from_file.nearest(scan(mean), 7) == from_table.nearest(scan(mean), 7)
    assert scans(from_file, 7, include_running=False) == scans(from_table, 7, include_running=False)


def test_a_file_is_read_again_only_if_it_changed_or_another_map_is_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'a.map'
    reads: list[Path] = []

    def counted(path: Path, start: Callable[[int, int], PlaceIndex]) -> tuple[str, PlaceIndex]:
        reads.append(path)
        return read_committed(path, start)

    monkeypatch.setattr(searched_map, 'read_committed', counted)
    stored_map(path, count=3, running=False).close()
    searched = SearchedMap()

    def times_read() -> int:
        reads.clear()
        searched.load_file(path)
        return len(reads)

    def nearest() -> int:
        return searched.nearest(scan((100, 100), stamp=8), 1, include_running=True)[0].place_id

    assert times_read() == 1
    with SessionMap(MapConfig(path=str(path))) as session_map:
        searched.update(places((7, (100, 100)), session=2), MODEL, committed=False)
        assert nearest() == 7
        assert times_read() == 0
        # load_file also discards the changes of the running session.
        assert nearest() == 2
        session_map.start_session('second', 2)
        session_map.merge(scan((1.0, 1.0), stamp=9), Pose(500.0, 0.0))
        session_map.end_session()
        assert (times_read(), len(searched)) == (1, 4)
        assert times_read() == 0
        session_map.undo_session()
        assert (times_read(), len(searched)) == (1, 3)
    searched.update(places((7, (100, 100))), MODEL, committed=True)
    assert (times_read(), len(searched)) == (1, 3)
    searched.load(places((1, (3, 4))), MODEL)
    assert (times_read(), len(searched)) == (1, 3)


def test_an_unreadable_file_leaves_the_map_unchanged(tmp_path: Path, searched: SearchedMap) -> None:
    (tmp_path / 'a.map').write_text('no map')
    with pytest.raises(MapError, match=r'a\.map'):
        searched.load_file(tmp_path / 'a.map')
    assert ids(searched.nearest(scan(), 2)) == [2, 1]


def test_updates_are_bounded_though_no_query_ever_comes(searched: SearchedMap) -> None:
    for i in range(1000):
        searched.update(places((1000 + i % 10, (0.5, 0)), session=2), MODEL, committed=False)
    assert len(searched._waiting_updates) == searched_map.MAX_WAITING_UPDATES


def test_an_update_without_places_changes_nothing(searched: SearchedMap) -> None:
    searched.update(places(), MODEL, committed=False)
    assert ids(searched.nearest(scan(stamp=100), 1, include_running=True)) == [2]


@pytest.mark.parametrize('committed', [True, False])
@pytest.mark.parametrize(
    ('column', 'value'),
    [('positions_m', np.nan), ('positions_m', 1e300), ('uncertainties', -1.0), ('yaws_rad', np.inf)],
)
def test_places_that_are_nowhere_are_refused(searched: SearchedMap, committed: bool, column: str, value: float) -> None:
    bad = places((1, (0, 0)), (9, (0, 0)))
    getattr(bad, column)[1, ...] = value
    with pytest.raises(RefusedInput, match='place 9 has') as refused:
        searched.update(bad, MODEL, committed=committed)
    assert refused.value.cause == 'invalid_place'
    with pytest.raises(RefusedInput, match='place 9 has'):
        searched.load(bad, MODEL)
    assert ids(searched.nearest(scan(stamp=100), 3, include_running=True)) == [2, 1, 3]
