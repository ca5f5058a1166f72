"""Whatever a message holds, it is a record or is refused with a cause: no other error, and no warning of NumPy."""

from __future__ import annotations

import itertools
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from hostile_messages import Hostile, hostile_messages, inputs
from rclpy.serialization import deserialize_message

from offradar_ros.config import EncoderConfig, RadarConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.mapping.place_check import place_problem
from offradar_ros.messages import point_from_fix, pose_from_odometry, scan_from_image, stamp_ns
from offradar_ros.ros.embedding_message import embedding_message, embedding_record, model_record
from offradar_ros.ros.place_message import descriptors_record, is_read_the_file
from offradar_ros.ros.signatures_message import signatures_record, wanted_record

ENCODER = make_encoder(EncoderConfig(name='ring_key'))
START_NS = 10**12
TRIED = 2400
CAUSES = {
    'embedding': {'wrong_fields', 'short_data', 'wrong_size', 'invalid_stamp', 'invalid_signature'},
    'embedding/model': {'wrong_fields', 'invalid_model'},
    'map/descriptors': {'wrong_fields', 'short_data', 'wrong_size', 'invalid_place', 'invalid_stamp'},
    'map/updates': {'wrong_fields', 'short_data', 'wrong_size', 'invalid_place', 'invalid_stamp', 'invalid_signature'},
    'map/signatures': {
        'wrong_fields',
        'short_data',
        'wrong_size',
        'invalid_place',
        'invalid_stamp',
        'invalid_signature',
    },
    'map/signatures_wanted': {'wrong_fields', 'short_data', 'wrong_size', 'invalid_place', 'invalid_stamp'},
    'gps/fix': {'no_fix', 'invalid_position', 'invalid_stamp'},
    'odometry': {'invalid_position', 'invalid_stamp'},
    'radar_data/b_scan_image': {
        'wrong_encoding',
        'empty_image',
        'short_step',
        'short_data',
        'image_too_large',
        'unknown_range_resolution',
        'invalid_stamp',
        'no_signal',
        'too_few_rows',
        'wrong_size',
    },
}
"""The causes of refusal on each topic."""


def encode(message: Any) -> None:
    embedding = ENCODER.encode(scan_from_image(message, RadarConfig()))
    assert embedding_problem(embedding) is None
    embedding_message(embedding, message.header.frame_id)


def rows(message: Any) -> None:
    if not is_read_the_file(message):
        place_problem(descriptors_record(message, 'map/descriptors').table)


def fix(message: Any) -> None:
    stamp_ns(message.header.stamp)
    point_from_fix(message)


def odometry(message: Any) -> None:
    stamp_ns(message.header.stamp)
    pose_from_odometry(message)


READ: dict[str, Callable[[Any], Any]] = {
    'radar_data/b_scan_image': encode,
    'embedding': lambda message: embedding_record(message, 'embedding'),
    'embedding/model': lambda message: model_record(message, 'embedding/model'),
    'map/descriptors': rows,
    'map/updates': rows,
    'map/signatures': lambda message: signatures_record(message, 'map/signatures'),
    'map/signatures_wanted': lambda message: wanted_record(message, 'map/signatures_wanted'),
    'gps/fix': fix,
    'odometry': odometry,
    'ground_truth/odometry': odometry,
}


def received(one: Hostile) -> Any:
    """The message as a subscriber has it; None for bytes that are not one."""
    if not isinstance(one.message, bytes):
        return one.message
    try:
        return deserialize_message(one.message, one.kind)
    except Exception:
        # What the middleware drops reaches no subscriber.
        return None


@pytest.mark.parametrize('seed', [1, 2])
def test_a_hostile_message_is_a_record_or_is_refused_with_a_cause(seed: int) -> None:
    refused: dict[str, Counter[str]] = {topic: Counter() for topic in READ}
    for one in itertools.islice(hostile_messages(seed, ENCODER.info, START_NS), TRIED):
        message = received(one)
        if message is None:
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('error')
                READ[one.topic](message)
        except RefusedInput as problem:
            assert len(str(problem)) < 5000
            refused[one.topic][problem.cause] += 1
    for topic, causes in CAUSES.items():
        assert set(refused[topic]) <= causes, (topic, refused[topic])
        assert refused[topic].total() > TRIED / len(READ) / 20, (topic, refused[topic])


def test_the_same_seed_gives_the_same_messages() -> None:
    one, other = (list(itertools.islice(hostile_messages(3, ENCODER.info, START_NS), 40)) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        if isinstance(a.message, bytes):
            # The middleware does not set the bytes between two fields.
            assert (a.topic, len(a.message)) == (b.topic, len(b.message))
        else:
            assert str(a.message) == str(b.message)
    assert {a.topic for a in one} == set(READ)


def test_the_inputs_are_sound_before_they_are_spoilt() -> None:
    for one in inputs(ENCODER.info, START_NS):
        for number in range(1, 5):
            READ[one.topic](one.make(number))
