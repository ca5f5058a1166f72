"""The query stage: a map from messages or a file, thresholds that change, and its warnings."""

import dataclasses
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from street_sequence import StreetSequence
from unprivileged import obey_permissions

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.signature_code import checksum_of, pack
from offradar_ros.config import MapConfig, QueryConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.mapping.place_check import MAX_MEAN_VALUE
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.retrieval.confidence import shipped_confidences
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, Match, Place, PlaceTable, Pose, ScanKey

MODEL = 'a' * 64


def table(*means: tuple[float, float]) -> PlaceTable:
    made = [Place(i, 1, i, Pose(0.0, 0.0), 0.9, np.asarray(mean, np.float32)) for i, mean in enumerate(means)]
    return PlaceTable.from_places(made, 2)


def scan(uncertainty: float = 1.0) -> Embedding:
    return Embedding(5, np.zeros(2, np.float32), np.full(2, uncertainty, np.float32), MODEL)


def signed_scan(index: int, stamp_ns: int = 5) -> Embedding:
    """A scan of the street, whose signature is real."""
    signature = pack(SignatureMaker()(StreetSequence().scan(index)))
    return dataclasses.replace(scan(), stamp_ns=stamp_ns, signature=signature)


def write_map(path: Path) -> None:
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(ModelInfo('ring_key', MODEL, 2, {}))
        session_map.start_session('first', 1)
        session_map.merge(scan(), Pose(0.0, 0.0))
        session_map.end_session()


def test_thresholds_change_and_the_map_stays() -> None:
    stage = QueryStage(QueryConfig())
    stage.load(table((0, 0)), MODEL)
    assert stage.threshold == 1.5
    assert isinstance(stage.query(scan(1.2)), Match)
    stage.reconfigure(dataclasses.replace(stage.config, level=5))
    assert stage.threshold == 1.0
    assert not isinstance(stage.query(scan(1.2)), Match)
    assert stage.places == 1


def test_updates_reach_the_map() -> None:
    stage = QueryStage(QueryConfig())
    stage.update(table((0, 0), (1, 1)), MODEL, committed=True)
    assert stage.places == 2
    with pytest.raises(RefusedInput, match='places dropped'):
        stage.update(table((0, 0)), 'b' * 64, committed=True)


def aligned(stage: QueryStage) -> list[int]:
    """The places that a scan of the street is aligned with."""
    return [c.place_id for c in stage.query(signed_scan(4)).candidates if c.alignment is not None]


def test_places_are_aligned_as_their_signatures_come() -> None:
    stage = QueryStage(QueryConfig())
    checksum = checksum_of(signed_scan(4).signature)
    stage.load(table((0, 0), (1, 1), (2, 2)), MODEL, (checksum, checksum, 0))
    assert (stage.missing_signatures, aligned(stage)) == (2, [])
    assert stage.not_aligned == '2 signatures of the map have not come yet from the map server, on map/signatures'
    assert stage.wanted_signatures() == (ScanKey(1, 0), ScanKey(1, 1))
    stage.receive_signatures({ScanKey(1, 1): signed_scan(4).signature})
    assert aligned(stage) == [1]
    assert stage.not_aligned == ''
    stage.receive_signatures({ScanKey(1, 0): b''})
    assert (stage.missing_signatures, aligned(stage)) == (0, [1])


def test_rows_bring_their_signatures_and_the_map_that_follows_is_not_asked_for() -> None:
    stage = QueryStage(QueryConfig())
    rows = table((0, 0), (1, 1))
    stage.update(rows, MODEL, committed=False, signatures=(signed_scan(4).signature, b''))
    stage.load(rows, MODEL, (checksum_of(signed_scan(4).signature), 5))
    assert stage.wanted_signatures() == (ScanKey(1, 1),)
    assert aligned(stage) == [0]
    # As a map server without signatures sends it.
    stage.load(rows, MODEL)
    assert (stage.missing_signatures, aligned(stage)) == (0, [])
    assert stage.not_aligned.startswith('the map has no signatures of the places found')


def test_rows_that_are_refused_leave_no_signatures() -> None:
    stage = QueryStage(QueryConfig())
    stage.load(table((0, 0)), MODEL)
    with pytest.raises(RefusedInput):
        stage.update(table((0, 0)), 'b' * 64, committed=False, signatures=(signed_scan(4).signature,))
    assert aligned(stage) == []


def test_signatures_are_asked_for_only_where_scans_are_aligned_and_there_is_no_file(tmp_path: Path) -> None:
    write_map(tmp_path / 'a.map')
    of_file = QueryStage(QueryConfig(map_path=str(tmp_path / 'a.map')))
    of_file.load(table((0, 0)), MODEL, (5,))
    assert (of_file.wanted_signatures(), of_file.missing_signatures) == ((), 0)
    stage = QueryStage(QueryConfig(verify=False))
    stage.load(table((0, 0)), MODEL, (5,))
    assert (stage.wanted_signatures(), stage.missing_signatures) == ((), 0)
    stage.reconfigure(dataclasses.replace(stage.config, verify=True))
    assert stage.wanted_signatures() == (ScanKey(1, 0),)


def test_it_warns_of_a_missing_map_and_of_a_mean_u_far_from_1() -> None:
    stage = QueryStage(QueryConfig())
    assert stage.warning == 'no map to search'
    assert math.isnan(stage.mean_uncertainty)
    stage.load(table((0, 0)), MODEL)
    assert stage.warning == ''
    stage.query(Embedding(5, np.empty(0, np.float32), np.empty(0, np.float32)))
    assert math.isnan(stage.mean_uncertainty)
    for uncertainty in (1.5, 1.7):
        stage.query(scan(uncertainty))
    assert stage.mean_uncertainty == pytest.approx(1.6)
    assert stage.warning == 'mean U 1.60 is not near 1: calibrate for this sensor'
    for _ in range(300):
        stage.query(scan(1.0))
    assert (stage.mean_uncertainty, stage.warning) == (1.0, '')


def test_a_map_file_is_read_at_start_or_later(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    stage = QueryStage(QueryConfig(map_path=str(path)))
    assert stage.open_file()
    write_map(path)
    assert not stage.open_file()
    assert stage.places == 1
    assert not QueryStage(QueryConfig()).open_file()
    with pytest.raises(MapError, match='no map file there'):
        QueryStage(QueryConfig(map_path=str(tmp_path / 'no folder' / 'a.map'))).open_file()


def test_a_map_file_in_a_folder_that_may_not_be_searched_is_refused(tmp_path: Path) -> None:
    program = (
        'import sys; from offradar_ros.config import QueryConfig; from offradar_ros.errors import MapError; '
        'from offradar_ros.stages.query import QueryStage\n'
        'try: QueryStage(QueryConfig(map_path=sys.argv[1])).open_file()\n'
        'except MapError as error: print(error)'
    )
    path = tmp_path / 'locked' / 'a.map'
    path.parent.mkdir(0o000)
    ran = subprocess.run(
        [sys.executable, '-c', program, str(path)],
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=obey_permissions,
    )
    assert ran.stdout.startswith(f'{path}: cannot be read (Permission denied)')


def test_a_map_too_large_for_a_message_needs_a_file(tmp_path: Path) -> None:
    with pytest.raises(RefusedInput, match=r'query\.map_path') as refused:
        QueryStage(QueryConfig()).read_file()
    assert refused.value.cause == 'map_too_large'
    write_map(tmp_path / 'a.map')
    stage = QueryStage(QueryConfig(map_path=str(tmp_path / 'a.map')))
    stage.read_file()
    assert isinstance(stage.query(scan()), Match)


def test_a_map_that_cannot_be_localised_in_is_told_of_once_and_queries_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    model = next(iter(shipped_confidences()))
    monkeypatch.setattr('offradar_ros.belief.place_graph.MAX_PAIRS', 2)
    stage = QueryStage(QueryConfig())
    stage.load(table((0, 0), (1, 1), (2, 2)), model)
    stage.query(dataclasses.replace(scan(), model=model))
    assert stage.not_localised == ''
    with pytest.raises(RefusedInput, match='3 pairs of places'):
        stage.localise()
    for stamp_ns in (6, 7):
        answer = stage.query(dataclasses.replace(scan(), model=model, stamp_ns=stamp_ns))
        assert answer.candidates
        assert stage.localise() is None
    assert '3 pairs of places' in stage.not_localised
    assert stage.relocalise().detail == stage.not_localised
    stage.load(table((0, 0), (1, 1)), model)
    stage.query(dataclasses.replace(scan(), model=model, stamp_ns=8))
    assert stage.localise() is not None


def test_the_service_says_so_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('offradar_ros.belief.place_graph.MAX_PAIRS', 2)
    stage = QueryStage(QueryConfig())
    stage.load(table((0, 0), (1, 1), (2, 2)), next(iter(shipped_confidences())))
    assert '3 pairs of places' in stage.relocalise().detail


@pytest.mark.parametrize('variance', [0.0, 1e-38, 3e38])
@pytest.mark.parametrize('value', [MAX_MEAN_VALUE, -MAX_MEAN_VALUE, 1e-38])
@pytest.mark.filterwarnings('error')
def test_an_extreme_embedding_is_answered_and_does_not_spoil_the_belief(value: float, variance: float) -> None:
    model = next(iter(shipped_confidences()))
    stage = QueryStage(QueryConfig())
    stage.load(table((0, 0), (1, 1), (-value, value)), model)
    extreme = Embedding(5, np.full(2, value, np.float32), np.full(2, variance, np.float32), model)
    answer = stage.query(extreme)
    assert 0.0 <= answer.p_right <= 1.0 and answer.candidates
    assert stage.localise() is not None
    sound = stage.query(dataclasses.replace(scan(), stamp_ns=6, model=model))
    assert (0.0 <= sound.p_right <= 1.0, sound.candidates[0].distance) == (True, 0.0)
    found = stage.localise()
    assert found is not None and 0.0 <= found.p_on_map <= 1.0 and np.isfinite(found.position_m).all()
