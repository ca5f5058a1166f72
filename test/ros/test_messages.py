"""Records are unchanged after a message and its CDR bytes; messages of other kinds are refused by topic."""

from __future__ import annotations

import array
import dataclasses
import json
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from offradar_ros.config import QueryConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import RefusedInput
from offradar_ros.messages import pose_from_odometry
from offradar_ros.ros.clouds import from_cloud
from offradar_ros.ros.embedding_message import (
    POINT,
    embedding_message,
    embedding_record,
    model_message,
    model_record,
)
from offradar_ros.ros.localisation_message import (
    localisation_message,
    localisation_pose_message,
    localisation_record,
)
from offradar_ros.ros.outcome_message import (
    match_message,
    match_pose_message,
    match_record,
    rejection_message,
    rejection_record,
)
from offradar_ros.ros.place_message import (
    VIEW,
    PlaceRows,
    descriptors_message,
    descriptors_record,
    map_message,
)
from offradar_ros.types import (
    Alignment,
    Candidate,
    Embedding,
    Evidence,
    Localisation,
    LocalisationState,
    Match,
    Place,
    PlaceTable,
    Pose,
    Reason,
    Rejection,
)

MODEL = 'ab' * 32
STAMP_NS = 1_600_000_000_123_456_789

float32s = st.floats(width=32)
stamps = st.integers(0, 2**31 * 10**9 - 1)


def transmitted(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


@settings(max_examples=50, deadline=None)
@given(stamp=stamps, values=st.lists(st.tuples(float32s, float32s), max_size=200))
def test_an_embedding_of_any_numbers_is_unchanged(stamp: int, values: list[tuple[float, float]]) -> None:
    mean, variance = np.array(values, np.float32).reshape(-1, 2).T
    message = transmitted(embedding_message(Embedding(stamp, mean, variance, MODEL), 'radar'))
    back = embedding_record(message, 'embedding')
    assert (message.header.frame_id, message.height, message.width) == ('radar', 1, len(mean))
    assert back.stamp_ns == stamp
    assert back.model == (MODEL if len(mean) else '')
    np.testing.assert_array_equal(back.mean, mean)
    np.testing.assert_array_equal(back.variance, variance)


def test_an_embedding_is_a_cloud_of_named_float32_fields() -> None:
    mean = np.arange(4, dtype=np.float32)
    message = embedding_message(Embedding(STAMP_NS, mean, mean + 1, MODEL), 'radar')
    fields = {field.name: (field.offset, field.datatype, field.count) for field in message.fields}
    assert fields['mean'] == (0, PointField.FLOAT32, 1)
    assert fields['variance'] == (4, PointField.FLOAT32, 1)
    first_mean = np.frombuffer(bytes(message.data), np.float32)[0 :: message.point_step // 4]
    np.testing.assert_array_equal(first_mean, mean)


def test_a_model_is_unchanged() -> None:
    info = ModelInfo('ring_key', MODEL, 128, {'rings': '128', 'note': 'ümlaut "quoted"'})
    assert model_record(transmitted(model_message(info)), 'embedding/model') == info


@pytest.mark.parametrize('message', [DiagnosticStatus(), DiagnosticStatus(name='other')])
def test_another_status_is_no_model(message: DiagnosticStatus) -> None:
    with pytest.raises(RefusedInput, match='embedding/model: expected fingerprint'):
        model_record(message, 'embedding/model')


def table(count: int, dimension: int) -> PlaceTable:
    rng = np.random.default_rng(count)
    return PlaceTable.from_places(
        [
            Place(
                place_id=int(2**31 + i),
                session_id=i % 3,
                stamp_ns=STAMP_NS + i,
                pose=Pose(x_m, y_m, z_m, math.nan if i % 2 else 0.25, math.nan if i % 4 else 0.03),
                uncertainty=float(np.float32(rng.random())),
                mean=rng.normal(size=dimension).astype(np.float32),
            )
            for i, (x_m, y_m, z_m) in enumerate(rng.normal(0, 1e4, (count, 3)).tolist())
        ],
        dimension,
    )


@pytest.mark.parametrize(('count', 'dimension'), [(0, 8), (1, 1), (3, 128), (500, 16)])
@pytest.mark.parametrize('committed', [True, False])
def test_places_are_unchanged_to_the_last_bit(count: int, dimension: int, committed: bool) -> None:
    before = table(count, dimension)
    back = descriptors_record(
        transmitted(descriptors_message(PlaceRows(before, MODEL, committed), STAMP_NS)), 'map/updates'
    )
    for field in dataclasses.fields(PlaceTable):
        np.testing.assert_array_equal(getattr(back.table, field.name), getattr(before, field.name), err_msg=field.name)
    assert back.table.means.shape == (count, dimension)
    if count:
        assert (back.model, back.committed) == (MODEL, committed)


def test_standard_deviations_of_headings_are_a_field_where_they_are_known() -> None:
    """Messages of earlier versions, and of maps that have none, are without it."""
    known = table(5, 4)
    unknown = dataclasses.replace(known, yaw_sds_rad=np.full(5, np.nan, np.float32))
    for rows, has_field in ((known, True), (unknown, False)):
        message = descriptors_message(PlaceRows(rows, MODEL, committed=True), STAMP_NS)
        assert ('yaw_sd' in {field.name for field in message.fields}) == has_field
        found = descriptors_record(transmitted(message), 'map/updates').table
        np.testing.assert_array_equal(found.yaw_sds_rad, rows.yaw_sds_rad)


@pytest.mark.parametrize(
    ('variance', 'sd_rad'),
    [(0.0004, 0.02), (0.0, math.nan), (-1.0, math.nan), (math.nan, math.nan), (1e6, math.pi), (math.inf, math.pi)],
)
def test_the_heading_of_odometry_is_as_certain_as_its_covariance(variance: float, sd_rad: float) -> None:
    message = Odometry()
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(0.35), math.cos(0.35)
    message.pose.covariance[35] = variance
    found = pose_from_odometry(transmitted(message))
    assert found.yaw_rad == pytest.approx(0.7)
    assert found.yaw_sd_rad == pytest.approx(sd_rad, nan_ok=True)


def test_the_map_view_shows_uncertainty_as_intensity() -> None:
    places = table(5, 4)
    points = from_cloud(transmitted(map_message(places, STAMP_NS)), VIEW, 'map')
    np.testing.assert_array_equal(points['intensity'], places.uncertainties)
    np.testing.assert_allclose(points['x'], places.positions_m[:, 0], rtol=1e-6)


CANDIDATES = (
    Candidate(7, 0.5, 0.25, Pose(1.0, 2.0, 3.0, 0.5)),
    Candidate(
        8, 0.75, 0.5, Pose(7.0, 8.0, 9.0, -0.5), Alignment(np.array([1.1, -2.2, 3.1]), np.diag([0.1, 0.2, 0.3]), 0.7)
    ),
    Candidate(4_000_000_000, 1.5, 1.25, Pose(-4.0, 5.0, 0.0, math.nan)),
)


def same_candidates(found: tuple[Candidate, ...], expected: tuple[Candidate, ...]) -> None:
    def columns(candidates: tuple[Candidate, ...]) -> list[tuple[float, ...]]:
        poses = [c.pose for c in candidates]
        ends = [alignment_numbers(c.alignment) for c in candidates]
        return [
            (c.place_id, c.distance, c.uncertainty, pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad, *end)
            for c, pose, end in zip(candidates, poses, ends, strict=True)
        ]

    np.testing.assert_array_equal(columns(found), columns(expected))


def alignment_numbers(alignment: Alignment | None) -> list[float]:
    if alignment is None:
        return [math.nan] * 13
    return [alignment.score, *alignment.pose.tolist(), *alignment.covariance.ravel().tolist()]


def test_a_match_is_unchanged() -> None:
    evidence = Evidence(0.5, 0.7, math.inf, 0.123456789012345, 0.25)
    match = Match(STAMP_NS, 0.123456789012345, 1.1, CANDIDATES, 0.987654321098765, evidence)
    back = match_record(transmitted(match_message(match)), 'matches')
    assert (back.stamp_ns, back.uncertainty, back.threshold) == (match.stamp_ns, match.uncertainty, match.threshold)
    assert (back.p_right, back.evidence) == (match.p_right, evidence)
    same_candidates(back.candidates, CANDIDATES)


def test_a_match_without_a_probability_is_unchanged() -> None:
    back = match_record(transmitted(match_message(Match(STAMP_NS, 0.5, 1.1, CANDIDATES))), 'matches')
    assert math.isnan(back.p_right)
    assert back.evidence is None


def test_a_match_is_a_pose_of_unknown_heading() -> None:
    config = QueryConfig(position_sigma_m=10.0)
    message = transmitted(match_pose_message(Match(STAMP_NS, 0.5, 1.0, CANDIDATES), config))
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    assert (message.header.frame_id, message.pose.pose.position.x) == ('map', 1.0)
    assert 2 * math.atan2(message.pose.pose.orientation.z, message.pose.pose.orientation.w) == pytest.approx(0.5)
    assert covariance[0, 0] == 100.0
    assert covariance[5, 5] == pytest.approx(math.pi**2)
    np.testing.assert_array_equal(covariance, np.diag(np.diag(covariance)))


def test_an_aligned_match_is_the_pose_of_the_vehicle() -> None:
    place = Pose(10.0, 20.0, 3.0, math.pi / 2)
    alignment = Alignment(np.array([4.0, 1.0, 0.2]), np.array([[0.04, 0, 0], [0, 0.09, 0], [0, 0, 0.01]]), 0.8)
    match = Match(STAMP_NS, 0.5, 1.0, (Candidate(7, 0.5, 0.25, place, alignment),))
    config = QueryConfig(place_sigma_m=0.5, place_sigma_deg=0.0, position_sigma_m=10.0)
    message = transmitted(match_pose_message(match, config))
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    assert (position.x, position.y, position.z) == pytest.approx((9.0, 24.0, 3.0))
    assert 2 * math.atan2(orientation.z, orientation.w) == pytest.approx(math.pi / 2 + 0.2)
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    # The place looks to the north: forward is y.
    expected = np.diag([0.25 + 0.09, 0.25 + 0.04, 100.0, math.pi**2, math.pi**2, 0.01])
    np.testing.assert_allclose(covariance, expected, atol=1e-12)


@pytest.mark.parametrize('reason', list(Reason))
@pytest.mark.parametrize('uncertainty', [0.1, math.nan])
@pytest.mark.parametrize('candidates', [(), CANDIDATES])
def test_a_rejection_is_unchanged(reason: Reason, uncertainty: float, candidates: tuple[Candidate, ...]) -> None:
    rejection = Rejection(STAMP_NS, reason, uncertainty, 1.1, candidates, 'U 2: above the threshold: 1.1')
    back = rejection_record(transmitted(rejection_message(rejection)), 'rejections')
    assert (back.stamp_ns, back.reason, back.threshold, back.detail) == (STAMP_NS, reason, 1.1, rejection.detail)
    np.testing.assert_equal(back.uncertainty, uncertainty)
    same_candidates(back.candidates, candidates)


def test_a_rejection_keeps_its_probability_and_evidence() -> None:
    evidence = Evidence(0.5, 0.55, 0.6, 1.234567890123456, 0.25)
    rejection = Rejection(STAMP_NS, Reason.AMBIGUOUS, 1.234567890123456, 1.5, CANDIDATES, 'two places', 0.25, evidence)
    back = rejection_record(transmitted(rejection_message(rejection)), 'rejections')
    assert (back.reason, back.p_right, back.evidence) == (Reason.AMBIGUOUS, 0.25, evidence)


@pytest.mark.parametrize('message', [DiagnosticArray(), DiagnosticArray(status=[DiagnosticStatus()])])
def test_another_array_is_no_rejection(message: DiagnosticArray) -> None:
    with pytest.raises(RefusedInput, match='rejections: expected reason'):
        rejection_record(message, 'rejections')


def test_a_cloud_without_our_fields_is_refused_by_topic() -> None:
    with pytest.raises(RefusedInput, match='embedding: expected fields mean, variance, model') as refusal:
        embedding_record(PointCloud2(height=1), 'embedding')
    assert refusal.value.cause == 'wrong_fields'


@pytest.mark.parametrize(
    'damage',
    [
        {'width': 9},
        {'is_bigendian': True},
        {'point_step': 2},
        {'data': b''},
    ],
)
def test_a_cloud_of_another_size_than_stated_is_refused(damage: dict[str, Any]) -> None:
    mean = np.ones(4, np.float32)
    message = embedding_message(Embedding(STAMP_NS, mean, mean, MODEL), 'radar')
    fields = {
        name: getattr(message, name)
        for name in ('fields', 'width', 'height', 'point_step', 'row_step', 'data', 'is_bigendian')
    }
    with pytest.raises(RefusedInput):
        from_cloud(SimpleNamespace(**(fields | damage)), POINT, 'embedding')


@settings(max_examples=50, deadline=None)
@given(
    stamp=stamps,
    state=st.sampled_from(LocalisationState),
    numbers=st.lists(st.floats(allow_nan=True, allow_infinity=False), min_size=7, max_size=7),
    place_id=st.none() | st.integers(0, 2**31),
)
def test_a_localisation_is_unchanged_to_the_last_bit(
    stamp: int, state: LocalisationState, numbers: list[float], place_id: int | None
) -> None:
    p_on_map, p_here, x_m, y_m, xx, xy, yy = numbers
    found = Localisation(stamp, state, p_on_map, place_id, p_here, np.array([x_m, y_m]), np.array([[xx, xy], [xy, yy]]))
    back = localisation_record(transmitted(localisation_message(found)), 'localisation')
    assert (back.stamp_ns, back.state, back.place_id) == (stamp, state, place_id)
    assert repr((back.p_on_map, back.p_here)) == repr((p_on_map, p_here))
    np.testing.assert_array_equal(back.position_m, found.position_m)
    np.testing.assert_array_equal(back.covariance_m2, found.covariance_m2)


def test_a_localisation_is_ok_for_a_person_only_on_the_map() -> None:
    position_m, covariance_m2 = np.array([3.0, -4.0]), np.array([[9.0, 1.0], [1.0, 4.0]])
    on_map, off_map = (
        Localisation(STAMP_NS, state, 0.75, 7, 0.5, position_m, covariance_m2)
        for state in (LocalisationState.ON_MAP, LocalisationState.OFF_MAP)
    )
    assert localisation_message(on_map).status[0].level == DiagnosticStatus.OK
    warned = localisation_message(off_map).status[0]
    assert (warned.level, warned.message) == (DiagnosticStatus.WARN, 'off_map: on the map with probability 0.7500')
    pose = transmitted(localisation_pose_message(on_map))
    assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == (3.0, -4.0)
    covariance = pose.pose.covariance.reshape(6, 6)
    np.testing.assert_array_equal(covariance[:2, :2], covariance_m2)
    assert covariance[5, 5] == pytest.approx(math.pi**2)


def test_a_message_of_another_kind_is_no_localisation() -> None:
    with pytest.raises(RefusedInput, match='localisation: expected state'):
        localisation_record(DiagnosticArray(), 'localisation')


def a_model(**changes: str) -> DiagnosticStatus:
    message = model_message(ModelInfo('ring_key', MODEL, 128, {'rings': '128'}))
    for item in message.values:
        item.value = changes.get(item.key, item.value)
    return message


@pytest.mark.parametrize(
    ('changes', 'cause'),
    [
        ({'dimension': '1000000000000'}, 'wrong_fields'),
        ({'dimension': '65537'}, 'invalid_model'),
        ({'dimension': '0'}, 'invalid_model'),
        ({'dimension': '-1'}, 'wrong_fields'),
        ({'dimension': '1_2'}, 'wrong_fields'),
        ({'dimension': '٣'}, 'wrong_fields'),
        ({'dimension': '9' * 10_000}, 'wrong_fields'),
        ({'fingerprint': 'ab' * 31}, 'invalid_model'),
        ({'fingerprint': 'AB' * 32}, 'invalid_model'),
        ({'fingerprint': 'zz' * 32}, 'invalid_model'),
        ({'metadata': '{"a": "\\ud800"}'}, 'invalid_model'),
        ({'metadata': '{"a": 1}'}, 'invalid_model'),
        ({'metadata': '{"a": "%s"}' % ('x' * 70_000)}, 'invalid_model'),
        ({'metadata': '[]'}, 'wrong_fields'),
        ({'metadata': '[' * 200_000}, 'wrong_fields'),
        ({'metadata': '{"a": ' * 1000 + '1' + '}' * 1000}, 'wrong_fields'),
        ({'metadata': '{"a": "%s"}' % ('x' * 2**21)}, 'wrong_fields'),
    ],
)
def test_a_model_is_checked_before_anything_is_made_of_it(changes: dict[str, str], cause: str) -> None:
    with pytest.raises(RefusedInput, match='embedding/model: ') as refusal:
        model_record(a_model(**changes), 'embedding/model')
    assert refusal.value.cause == cause


def test_a_model_of_very_many_values_or_with_a_long_name_is_refused() -> None:
    message = a_model()
    message.values = [*message.values, *message.values * 100]
    with pytest.raises(RefusedInput, match='expected fingerprint'):
        model_record(message, 'embedding/model')
    message = a_model()
    message.name = 'x' * 10**6
    with pytest.raises(RefusedInput, match='printable name') as refusal:
        model_record(message, 'embedding/model')
    assert len(str(refusal.value)) < 200


@pytest.mark.parametrize(('seconds', 'nanoseconds'), [(-1, 0), (-(2**31), 5), (1, 10**9), (0, 2**32 - 1)])
def test_a_stamp_that_is_none_is_refused_in_every_kind_of_message(seconds: int, nanoseconds: int) -> None:
    rejection = rejection_message(Rejection(1, Reason.MAP_EMPTY, 1.0, 1.5, (), ''))
    covariance = np.eye(2)
    found = Localisation(1, LocalisationState.LOST, 0.0, None, 0.0, np.zeros(2), covariance)
    read: list[tuple[Any, Any]] = [
        (
            embedding_message(Embedding(1, np.ones(2, np.float32), np.ones(2, np.float32), MODEL), 'radar'),
            embedding_record,
        ),
        (match_message(Match(1, 0.5, 1.1, CANDIDATES)), match_record),
        (rejection, rejection_record),
        (localisation_message(found), localisation_record),
    ]
    for message, record in read:
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        with pytest.raises(RefusedInput, match='header stamp') as refusal:
            record(transmitted(message), 'topic')
        assert refusal.value.cause == 'invalid_stamp'


@pytest.mark.parametrize('column', ['stamp_nanosec', 'session_id'])
def test_a_place_that_a_table_cannot_hold_is_refused(column: str) -> None:
    message = descriptors_message(PlaceRows(table(3, 4), MODEL, committed=True), STAMP_NS)
    offset = next(field.offset for field in message.fields if field.name == column)
    at = message.point_step + offset
    message.data[at : at + 4] = array.array('B', b'\xff\xff\xff\xff')
    with pytest.raises(RefusedInput, match='no valid stamp or session id') as refusal:
        descriptors_record(message, 'map/updates')
    assert refusal.value.cause == 'invalid_place'


@pytest.mark.parametrize(
    'candidates',
    [
        '[' * 200_000,
        '5',
        '{}',
        '[5]',
        '[[]]',
        '[{}]',
        json.dumps([{}] * 1001),
        *(
            json.dumps(
                [{'place_id': 1, 'distance': 1.0, 'uncertainty': 1.0, 'x': 1, 'y': 1, 'z': 1, 'yaw': None} | wrong]
            )
            for wrong in (
                {'place_id': -1},
                {'place_id': 1.5},
                {'place_id': 2**32},
                {'x': 'far'},
                {'x': True},
                {'x': math.nan},
                {'y': math.inf},
                {'z': 10**400},
                {'distance': None},
                {'uncertainty': [1.0]},
                {'yaw': math.inf},
            )
        ),
    ],
)
def test_candidates_that_are_none_are_refused(candidates: str) -> None:
    message = rejection_message(Rejection(STAMP_NS, Reason.UNCERTAIN, 2.0, 1.5, CANDIDATES, ''))
    message.status[0].values[-1].value = candidates
    with pytest.raises(RefusedInput, match='rejections: expected reason') as refusal:
        rejection_record(message, 'rejections')
    assert refusal.value.cause == 'wrong_fields'


@pytest.mark.parametrize('changes', [{'x_m': math.inf}, {'z_m': math.nan}, {'yaw_rad': -math.inf}])
def test_a_match_with_a_place_that_is_nowhere_is_refused(changes: dict[str, float]) -> None:
    place = Candidate(7, 0.5, 0.25, dataclasses.replace(Pose(1.0, 2.0, 3.0, 0.5), **changes))
    with pytest.raises(RefusedInput, match='not finite') as refusal:
        match_record(match_message(Match(STAMP_NS, 0.5, 1.1, (place,))), 'matches')
    assert refusal.value.cause == 'invalid_place'


@pytest.mark.parametrize('count', [0, 1001])
def test_a_match_has_as_many_places_as_one_can_ask_for(count: int) -> None:
    message = match_message(Match(STAMP_NS, 0.5, 1.1, CANDIDATES[:1] * count))
    with pytest.raises(RefusedInput, match=f'{count} places') as refusal:
        match_record(message, 'matches')
    assert refusal.value.cause == 'wrong_size'


def test_a_frame_of_endless_length_is_not_repeated() -> None:
    mean = np.ones(2, np.float32)
    message = embedding_message(Embedding(STAMP_NS, mean, mean, MODEL), 'x' * 10**6)
    assert message.header.frame_id == 'x' * 256
