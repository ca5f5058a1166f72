"""Sound messages on every topic that is read, and what is done with one: it is decoded and goes through the stages."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sample_signatures import packed_signature
from sensor_msgs.msg import Image, NavSatFix, PointCloud2

from faults.record_form import Form, Take, WrongValueTakenError
from offradar_ros.config import Config, RadarConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import OffradarError
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, pose_from_odometry, scan_from_image, stamp_ns
from offradar_ros.recordings.bags.reader import decode_message
from offradar_ros.ros.embedding_message import embedding_message, embedding_record, model_message, model_record
from offradar_ros.ros.localisation_message import localisation_message, localisation_record
from offradar_ros.ros.outcome_message import match_message, match_record, rejection_message, rejection_record
from offradar_ros.ros.place_message import PlaceRows, descriptors_message, descriptors_record
from offradar_ros.ros.stamps import header
from offradar_ros.stages.map import MapStage
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import (
    Candidate,
    Embedding,
    Localisation,
    LocalisationState,
    Match,
    Place,
    PlaceTable,
    Pose,
    Reason,
    Rejection,
)

DIMENSION = 8
SECOND = 10**9
INFO = ModelInfo('ring_key', 'ab' * 32, DIMENSION, {})


def received(kind: type, take: Callable[[Any], Any]) -> Take:
    """Deserialises as rclpy does for a node; what it cannot, no node ever sees."""

    def decode(cdr: bytes, _: Path) -> None:
        try:
            message = deserialize_message(cdr, kind)
        except (RuntimeError, MemoryError, UnicodeDecodeError, ValueError, OverflowError, SystemError) as error:
            raise OffradarError(f'not deserialised: {type(error).__name__}') from None
        take(message)

    return decode


def recorded(msgtype: str, take: Callable[[Any], Any]) -> Take:
    """Decodes as the reader of bags does; it names the bag at any error of decoding."""

    def decode(cdr: bytes, _: Path) -> None:
        try:
            message = decode_message(cdr, msgtype)
        except Exception as error:
            raise OffradarError(f'not decoded: {type(error).__name__}') from None
        take(message)

    return decode


def sample_embedding(k: int = 0) -> Embedding:
    """An embedding of the model."""
    mean = np.random.default_rng(k).standard_normal(DIMENSION).astype(np.float32)
    variance, signature = np.ones(DIMENSION, np.float32), packed_signature(k, 40, 20)
    return Embedding((k + 1) * SECOND, mean, variance, INFO.fingerprint, signature)


def sample_table(count: int = 4) -> PlaceTable:
    """Places of that model."""
    places = [Place(k, 1, k * SECOND, Pose(40.0 * k, 0.0, 0.0), 1.0, sample_embedding(k).mean) for k in range(count)]
    return PlaceTable.from_places(places, DIMENSION)


def new_map() -> MapStage:
    """A map in memory with a running session that knows the model."""
    stage = MapStage(Config(), SessionMap(Config().map))
    stage.adopt_model(INFO)
    stage.start_session(0)
    return stage


def new_query() -> QueryStage:
    """A query stage with a map of four places."""
    stage = QueryStage(Config().query, Config().localisation)
    stage.load(sample_table(), INFO.fingerprint)
    return stage


def require_finite(what: str, *values: Any) -> None:
    """Raise WrongValueTakenError where a number is not finite."""
    for value in values:
        if not np.isfinite(np.asarray(value, np.float64)).all():
            raise WrongValueTakenError(f'{what} is not finite: {value!r:.200}')


def require_sound_map(stage: MapStage) -> None:
    """The places that are in the map are finite, and the session can still be ended."""
    table = stage.map.places()
    require_finite('a place', table.positions_m, table.means, table.uncertainties)
    stage.end_session()


def take_embedding(message: PointCloud2) -> None:
    """Map and query with it."""
    embedding = embedding_record(message, 'embedding')
    stage = new_map()
    stage.add_pose(0, Pose(0.0, 0.0))
    stage.add_pose(embedding.stamp_ns + SECOND, Pose(1.0, 0.0))
    stage.add_embedding(embedding)
    stage.flush()
    require_sound_map(stage)
    outcome = new_query().query(embedding)
    if isinstance(outcome, Match):
        require_finite('a match', [candidate.distance for candidate in outcome.candidates])


def take_model(message: DiagnosticStatus) -> None:
    """Adopt the model in an empty map and in one that has another, then go on with the known one."""
    info = model_record(message, 'embedding/model')
    MapStage(Config(), SessionMap(Config().map)).adopt_model(info)
    stage = new_map()
    stage.add_pose(0, Pose(0.0, 0.0))
    stage.add_pose(3 * SECOND, Pose(1.0, 0.0))
    stage.add_embedding(sample_embedding())
    try:
        stage.adopt_model(info)
    finally:
        stage.add_embedding(sample_embedding(1))
        require_sound_map(stage)


def take_places(message: PointCloud2) -> None:
    """Search a map of these places, and one that they change."""
    rows = descriptors_record(message, 'map/descriptors')
    query = new_query()
    try:
        query.update(rows.table, rows.model, committed=rows.committed)
        query.load(rows.table, rows.model)
    finally:
        outcome = query.query(sample_embedding())
        if isinstance(outcome, Match):
            require_finite('a match', [(c.distance, c.pose.x_m, c.pose.y_m) for c in outcome.candidates])


def take_fix(message: Any) -> None:
    """Two scans are mapped around the position."""
    stage, stamp = new_map(), stamp_ns(message.header.stamp)
    stage.add_point(stamp, point_from_fix(message))
    stage.add_embedding(dataclasses.replace(sample_embedding(), stamp_ns=stamp))
    stage.flush()
    require_sound_map(stage)


def take_odometry(message: Any) -> None:
    """The same with a pose, for the map and for localisation."""
    stage, stamp, pose = new_map(), stamp_ns(message.header.stamp), pose_from_odometry(message)
    stage.add_pose(stamp, pose)
    stage.add_embedding(dataclasses.replace(sample_embedding(), stamp_ns=stamp))
    stage.flush()
    require_sound_map(stage)
    query = new_query()
    query.add_odometry(stamp, pose)
    query.query(sample_embedding())
    query.localise()


def take_image(message: Any) -> None:
    """Decode the scan."""
    scan = scan_from_image(message, RadarConfig())
    require_finite('an azimuth', scan.azimuths_rad, scan.range_resolution_m)


def message_forms() -> list[Form]:
    """Messages on every topic that is read."""
    match = Match(SECOND, 0.9, 1.5, (Candidate(1, 0.3, 0.8, Pose(1.0, 2.0, 3.0, 0.1)),), 0.95)
    rejection = Rejection(SECOND, Reason.UNCERTAIN, 2.0, 1.5, match.candidates, 'U is above the threshold', 0.2)
    found = Localisation(SECOND, LocalisationState.ON_MAP, 0.9, 3, 0.8, np.zeros(2), np.eye(2))
    fix = NavSatFix(header=header(SECOND, 'gps'), latitude=51.75, longitude=-1.25, altitude=70.0)
    pose = Odometry(header=header(SECOND, 'map'))
    pose.pose.pose.orientation.w = 1.0
    image = Image(header=header(SECOND, 'radar'), height=400, width=576, step=576, encoding='8UC1')
    image.data = np.random.default_rng(0).integers(0, 40, 400 * 576, np.uint8).tobytes()
    rows = PlaceRows(sample_table(), INFO.fingerprint, committed=True)
    samples: list[tuple[str, Any, Callable[[Any], Any], int]] = [
        ('embedding', embedding_message(sample_embedding(), 'radar'), take_embedding, 3000),
        (
            'embedding, without a signature',
            embedding_message(dataclasses.replace(sample_embedding(), signature=b''), 'radar'),
            take_embedding,
            3000,
        ),
        ('embedding/model', model_message(INFO), take_model, 4000),
        ('map/descriptors', descriptors_message(rows, SECOND), take_places, 6000),
        ('matches', match_message(match), functools.partial(match_record, topic='matches'), 2500),
        ('rejections', rejection_message(rejection), functools.partial(rejection_record, topic='rejections'), 3000),
        (
            'localisation',
            localisation_message(found),
            functools.partial(localisation_record, topic='localisation'),
            2500,
        ),
        ('gps/fix', fix, take_fix, 3000),
        ('odometry', pose, take_odometry, 3000),
        ('scans', image, take_image, 1000),
    ]
    live = [
        Form(f'message on {topic}', serialize_message(message), received(type(message), take), tries)
        for topic, message, take, tries in samples
    ]
    recorded_kinds = {
        'gps/fix': 'sensor_msgs/msg/NavSatFix',
        'odometry': 'nav_msgs/msg/Odometry',
        'scans': 'sensor_msgs/msg/Image',
    }
    in_a_bag = [
        Form(f'recorded message of {topic}', serialize_message(message), recorded(recorded_kinds[topic], take), tries)
        for topic, message, take, tries in samples
        if topic in recorded_kinds
    ]
    return [*live, *in_a_bag]
