"""Questions for signatures, their answers, and rows of the map with signatures: as they were sent, or refused."""

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
from offradar_ros.mapping.place_check import MAX_SESSION_ID
from offradar_ros.retrieval.received_signatures import MOST_WANTED
from offradar_ros.ros.place_message import PlaceRows, descriptors_message, descriptors_record
from offradar_ros.ros.signature_rows import MOST_DIFFERENT
from offradar_ros.ros.signatures_message import signatures_message, signatures_record, wanted_message, wanted_record
from offradar_ros.types import MAX_SIGNATURE_BYTES, Place, PlaceTable, Pose, ScanKey

MODEL = 'ab' * 32
SCANS = st.builds(ScanKey, st.integers(0, MAX_SESSION_ID), st.integers(0, 2**31 * 10**9 - 1))
SIGNATURES = st.just(b'') | st.builds(packed_signature, st.integers(0, 9), st.integers(8, 60), st.integers(8, 20))


def transmitted(message: PointCloud2) -> Any:
    return deserialize_message(serialize_message(message), PointCloud2)


@settings(max_examples=50, deadline=None)
@given(scans=st.lists(SCANS, min_size=1, max_size=MOST_WANTED, unique=True))
def test_a_question_arrives_as_it_was_sent(scans: list[ScanKey]) -> None:
    assert wanted_record(transmitted(wanted_message(scans, 7)), 'wanted') == tuple(scans)


@settings(max_examples=50, deadline=None)
@given(signatures=st.dictionaries(SCANS, SIGNATURES, min_size=1, max_size=MOST_WANTED))
def test_an_answer_arrives_as_it_was_sent(signatures: dict[ScanKey, bytes]) -> None:
    assert signatures_record(transmitted(signatures_message(signatures, 7)), 'signatures') == signatures


def test_the_largest_answer_is_half_a_megabyte() -> None:
    longest = bytes(range(1, 256)) * 33
    signatures = {ScanKey(1, stamp): longest[:MAX_SIGNATURE_BYTES] for stamp in range(MOST_WANTED)}
    message = signatures_message(signatures, 7)
    assert len(message.data) < 2**19 + 2**10
    assert signatures_record(transmitted(message), 'signatures') == signatures


@pytest.mark.parametrize('count', [0, MOST_WANTED + 1, 100_000])
def test_more_scans_than_a_question_has_are_refused(count: int) -> None:
    scans = [ScanKey(1, stamp) for stamp in range(count)]
    for message, read in (
        (wanted_message(scans, 7), wanted_record),
        (signatures_message(dict.fromkeys(scans, b''), 7), signatures_record),
    ):
        with pytest.raises(RefusedInput, match=f'{count} scans: expected 1 to {MOST_WANTED}') as refusal:
            read(message, 'topic')
        assert refusal.value.cause == 'wrong_size'


def changed(message: PointCloud2, field: str, value: int) -> PointCloud2:
    """The message with another value of an integer in its first point."""
    described = next(each for each in message.fields if each.name == field)
    size = {4: 2, 5: 4, 6: 4}[described.datatype]
    message.data[described.offset : described.offset + size] = type(message.data)(
        'B', (value % 2 ** (8 * size)).to_bytes(size, 'little')
    )
    return message


@pytest.mark.parametrize(('field', 'value'), [('stamp_sec', -1), ('stamp_nanosec', 10**9), ('session_id', 2**31)])
def test_a_scan_that_cannot_be_is_refused(field: str, value: int) -> None:
    for message, read in (
        (wanted_message([ScanKey(1, 5)], 7), wanted_record),
        (signatures_message({ScanKey(1, 5): b''}, 7), signatures_record),
    ):
        with pytest.raises(RefusedInput, match='no valid stamp or session id') as refusal:
            read(changed(message, field, value), 'topic')
        assert refusal.value.cause == 'invalid_place'


def table(count: int) -> PlaceTable:
    return PlaceTable.from_places(
        [Place(i, 3, 10**9 + i, Pose(1.0 * i, 0.0), 0.9, np.ones(4, np.float32)) for i in range(count)], 4
    )


def message_of_rows() -> PointCloud2:
    rows = PlaceRows(table(2), MODEL, committed=False, signatures=(packed_signature(1), packed_signature(2, 40, 20)))
    return descriptors_message(rows, 7)


@settings(max_examples=50, deadline=None)
@given(signatures=st.lists(SIGNATURES, min_size=1, max_size=4))
def test_rows_arrive_with_their_signatures(signatures: list[bytes]) -> None:
    places = table(len(signatures))
    sent = PlaceRows(places, MODEL, committed=False, signatures=tuple(signatures))
    found = descriptors_record(transmitted(descriptors_message(sent, 7)), 'map/updates')
    # Where no scan has one, the message has no field for them.
    assert found.signatures == (sent.signatures if any(signatures) else ())
    np.testing.assert_array_equal(found.table.means, places.means)
    assert found.table.scans() == places.scans()


@pytest.mark.parametrize('checksums', [(), (0, 0, 0), (1, 0, 2**32 - 1)])
def test_a_whole_map_has_checksums_in_place_of_signatures(checksums: tuple[int, ...]) -> None:
    message = descriptors_message(PlaceRows(table(3), MODEL, committed=True, checksums=checksums), 7)
    found = descriptors_record(transmitted(message), 'map/descriptors')
    assert found.checksums == (checksums if any(checksums) else ())
    assert found.signatures == ()
    plain = descriptors_message(PlaceRows(table(3), MODEL, committed=True), 7)
    assert len(message.data) - len(plain.data) == (4 * len(checksums) if any(checksums) else 0)


@pytest.mark.parametrize('size', [0, 1, 9, 65_535])
def test_a_size_that_is_not_that_of_the_signature_is_refused(size: int) -> None:
    for message, read in (
        (message_of_rows(), descriptors_record),
        (signatures_message({ScanKey(1, 5): packed_signature(1)}, 7), signatures_record),
    ):
        with pytest.raises(RefusedInput, match=f'a signature of {size} bytes in a field of') as refusal:
            read(changed(message, 'signature_bytes', size), 'topic')
        assert refusal.value.cause == 'invalid_signature'


def test_rows_with_a_damaged_signature_are_refused_with_it() -> None:
    message = message_of_rows()
    at = next(field.offset for field in message.fields if field.name == 'signature')
    message.data[at + 60] ^= 1
    with pytest.raises(RefusedInput, match='map/updates: signature of a scan: its checksum is wrong') as refusal:
        descriptors_record(message, 'map/updates')
    assert refusal.value.cause == 'invalid_signature'


def test_rows_with_more_signatures_than_can_be_checked_at_once_are_refused() -> None:
    count = MOST_DIFFERENT + 1
    signatures = tuple(bytes([number, 1]) for number in range(count))
    message = descriptors_message(PlaceRows(table(count), MODEL, committed=False, signatures=signatures), 7)
    with pytest.raises(RefusedInput, match=f'map/updates: rows with {count} signatures') as refusal:
        descriptors_record(message, 'map/updates')
    assert refusal.value.cause == 'wrong_size'


def test_a_column_longer_than_any_signature_is_refused() -> None:
    signatures = {ScanKey(1, 5): bytes(MAX_SIGNATURE_BYTES) + b'x'}
    with pytest.raises(RefusedInput, match='field signature has type 2') as refusal:
        signatures_record(signatures_message(signatures, 7), 'map/signatures')
    assert refusal.value.cause == 'wrong_fields'
