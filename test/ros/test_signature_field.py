"""The signature of a scan travels in the message of its embedding, and is there as it was made or not at all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sample_signatures import packed_signature
from sensor_msgs.msg import PointCloud2

from offradar_ros.errors import RefusedInput
from offradar_ros.ros.embedding_message import embedding_message, embedding_record
from offradar_ros.types import MAX_SIGNATURE_BYTES, Embedding

MODEL = 'ab' * 32


def embedding(dimension: int, signature: bytes) -> Embedding:
    mean = np.arange(dimension, dtype=np.float32)
    return Embedding(5, mean, mean + 1.0, MODEL, signature)


def transmitted(message: PointCloud2) -> Any:
    return deserialize_message(serialize_message(message), PointCloud2)


@settings(max_examples=100, deadline=None)
@given(
    dimension=st.integers(1, 300),
    signature=st.just(b'') | st.builds(packed_signature, st.integers(0, 9), st.integers(8, 60), st.integers(8, 20)),
)
def test_any_signature_arrives_as_it_was_sent(dimension: int, signature: bytes) -> None:
    sent = embedding(dimension, signature)
    found = embedding_record(transmitted(embedding_message(sent, 'radar')), 'embedding')
    assert found.signature == signature
    assert (found.stamp_ns, found.model) == (sent.stamp_ns, sent.model)
    np.testing.assert_array_equal(found.mean, sent.mean)
    np.testing.assert_array_equal(found.variance, sent.variance)


@pytest.mark.parametrize('dimension', [1, 2, 128, 4096, 65_536])
@pytest.mark.parametrize('shape', [(8, 8), (40, 20), (200, 80)])
def test_the_message_grows_by_the_signature_and_a_column_at_most(dimension: int, shape: tuple[int, int]) -> None:
    signature = packed_signature(0, *shape)
    message = embedding_message(embedding(dimension, signature), 'radar')
    assert embedding_record(message, 'embedding').signature == signature
    without = embedding_message(embedding(dimension, b''), 'radar')
    assert len(signature) < len(message.data) - len(without.data) <= len(signature) + 1 + dimension


@given(at=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_a_signature_of_which_one_bit_is_another_is_refused_with_its_embedding(at: int, bit: int) -> None:
    signature = bytearray(packed_signature(3))
    signature[at % len(signature)] ^= 1 << bit
    with pytest.raises(RefusedInput, match='embedding: signature of a scan: ') as refusal:
        embedding_record(embedding_message(embedding(7, bytes(signature)), 'radar'), 'embedding')
    assert refusal.value.cause == 'invalid_signature'
    assert '\n' not in str(refusal.value)


def test_without_a_signature_the_message_is_as_before_there_were_any() -> None:
    message = embedding_message(embedding(4, b''), 'radar')
    assert [field.name for field in message.fields] == ['mean', 'variance', 'model']
    assert (message.point_step, embedding_record(message, 'embedding').signature) == (40, b'')


def test_a_scan_that_could_not_be_encoded_has_none() -> None:
    message = embedding_message(embedding(0, b'abc'), 'radar')
    assert (message.width, embedding_record(message, 'embedding').signature) == (0, b'')


def with_bytes(message: PointCloud2, content: bytes) -> PointCloud2:
    """The message with other bytes in the field of the signature, which has as many."""
    field = next(field for field in message.fields if field.name == 'signature')
    points = np.frombuffer(message.data, np.uint8).reshape(message.width, message.point_step).copy()
    columns = points[:, field.offset : field.offset + field.count]
    columns[:] = np.frombuffer(content, np.uint8).reshape(columns.shape)
    message.data = points.tobytes()
    return message


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        # Of 4 points with 3 bytes each.
        (b'\0\0' + b'x' * 10, 'a signature of 0 bytes'),
        (b'\x0b\0' + b'x' * 10, 'a signature of 11 bytes'),
        (b'\xff\xff' + b'x' * 10, 'a signature of 65535 bytes'),
        (b'\x01\0' + b'x' + b'\0' * 9, 'a signature of 1 bytes'),
        (b'\x09\0' + b'x' * 10, 'a signature of 9 bytes'),
    ],
)
def test_a_field_that_holds_no_signature_is_refused(content: bytes, reason: str) -> None:
    message = with_bytes(embedding_message(embedding(4, b'x' * 10), 'radar'), content)
    with pytest.raises(RefusedInput, match=f'embedding: {reason} in 4 points of 3') as refusal:
        embedding_record(message, 'embedding')
    assert refusal.value.cause == 'invalid_signature'
    assert '\n' not in str(refusal.value)


def test_more_bytes_than_a_signature_may_have_are_refused_before_they_are_read() -> None:
    message = embedding_message(embedding(4, b'x' * (MAX_SIGNATURE_BYTES + 3)), 'radar')
    with pytest.raises(RefusedInput, match='field signature has type 2 and count 2050: not ours') as refusal:
        embedding_record(message, 'embedding')
    assert refusal.value.cause == 'wrong_fields'


def test_a_few_bytes_more_than_a_signature_may_have_are_refused() -> None:
    message = embedding_message(embedding(7, b'x' * (MAX_SIGNATURE_BYTES + 1)), 'radar')
    with pytest.raises(RefusedInput, match=f'expected 1 to {MAX_SIGNATURE_BYTES} bytes') as refusal:
        embedding_record(message, 'embedding')
    assert refusal.value.cause == 'invalid_signature'
