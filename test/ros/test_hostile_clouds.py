"""No description that a cloud gives of itself reaches memory: it is read as it should be, or refused."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sample_signatures import packed_signature
from sensor_msgs.msg import PointCloud2, PointField

from offradar_ros.encoders.protocol import MAX_DIMENSION
from offradar_ros.errors import RefusedInput
from offradar_ros.ros.clouds import MAX_FIELDS, MAX_POINT_BYTES, from_cloud
from offradar_ros.ros.embedding_message import POINT, embedding_message, embedding_record
from offradar_ros.ros.outcome_message import match_message, match_record
from offradar_ros.ros.place_message import (
    VIEW,
    PlaceRows,
    descriptors_message,
    descriptors_record,
    is_read_the_file,
    map_message,
)
from offradar_ros.ros.signatures_message import signatures_message, signatures_record, wanted_message, wanted_record
from offradar_ros.types import Candidate, Embedding, Match, Place, PlaceTable, Pose, ScanKey

MODEL = 'ab' * 32
PROJECT = Path(__file__).resolve().parents[2]
MEAN = np.arange(4, dtype=np.float32)
PLACES = PlaceTable.from_places([Place(i, 1, i, Pose(1.0, 2.0), 1.0, MEAN) for i in range(3)], 4)
SCANS = [ScanKey(1, i) for i in range(3)]
SIGNATURES = tuple(map(packed_signature, range(3)))
SOUND: dict[str, tuple[Callable[[], PointCloud2], Callable[[PointCloud2], Any]]] = {
    'embedding': (
        lambda: embedding_message(Embedding(1, MEAN, MEAN, MODEL), 'radar'),
        lambda cloud: embedding_record(cloud, 'embedding'),
    ),
    'signed embedding': (
        lambda: embedding_message(Embedding(1, MEAN, MEAN, MODEL, packed_signature(1)), 'radar'),
        lambda cloud: embedding_record(cloud, 'embedding'),
    ),
    'descriptors': (
        lambda: descriptors_message(PlaceRows(PLACES, MODEL, committed=True), 1),
        lambda cloud: descriptors_record(cloud, 'map/descriptors'),
    ),
    'signed rows': (
        lambda: descriptors_message(PlaceRows(PLACES, MODEL, committed=False, signatures=SIGNATURES), 1),
        lambda cloud: descriptors_record(cloud, 'map/updates'),
    ),
    'wanted': (
        lambda: wanted_message(SCANS, 1),
        lambda cloud: wanted_record(cloud, 'map/signatures_wanted'),
    ),
    'signatures': (
        lambda: signatures_message(dict(zip(SCANS, SIGNATURES, strict=True)), 1),
        lambda cloud: signatures_record(cloud, 'map/signatures'),
    ),
    'match': (
        lambda: match_message(Match(1, 1.0, 1.5, (Candidate(1, 0.5, 1.0, Pose(1.0, 2.0)),), 0.5)),
        lambda cloud: match_record(cloud, 'matches'),
    ),
    'view': (lambda: map_message(PLACES, 1), lambda cloud: from_cloud(cloud, VIEW, 'map')),
}
NEAR_LIMITS = [2**k + d for k in (16, 20, 24, 28, 29, 30, 31) for d in (-8, -4, -1, 0, 1, 4)] + [2**32 - 4, 2**32 - 1]


@pytest.mark.parametrize('kind', SOUND)
def test_sizes_near_the_limits_of_32_bits_never_end_the_process(kind: str) -> None:
    """In a process apart, which would crash: every field, with each of its sizes near a power of two."""
    paths = [str(PROJECT), str(PROJECT / 'benchmarks'), os.environ.get('PYTHONPATH', '')]
    done = subprocess.run(
        [sys.executable, __file__, kind],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(paths)},
    )
    assert (done.returncode, done.stderr[-2000:]) == (0, '')
    tried, refused = map(int, done.stdout.split())
    assert tried == refused > 300


def try_all(kind: str) -> tuple[int, int]:
    """How many clouds with one size changed there are, and how many of them are refused."""
    make, read = SOUND[kind]
    tried = refused = 0
    for points in (None, 0):
        for step in (None, 2**31 - 1, 2**32 - 1):
            for index in range(len(make().fields)):
                for name in ('offset', 'count'):
                    for value in NEAR_LIMITS:
                        cloud = make()
                        if points is not None:
                            cloud.width, cloud.row_step, cloud.data = 0, 0, b''
                        if step is not None:
                            cloud.point_step = step
                        setattr(cloud.fields[index], name, value)
                        tried += 1
                        try:
                            read(deserialize_message(serialize_message(cloud), PointCloud2))
                        except RefusedInput:
                            refused += 1
                        else:
                            # Only a count of the embedding itself may be another one, as far as points may be so large.
                            field = cloud.fields[index].name
                            refused += (field, name) == ('embedding', 'count') and value <= MAX_DIMENSION
    return tried, refused


@pytest.mark.parametrize('kind', SOUND)
@pytest.mark.parametrize('name', ['width', 'height', 'point_step', 'row_step'])
@pytest.mark.parametrize('value', [0, 2, 7, 2**16, 2**31, 2**32 - 1])
def test_a_cloud_whose_sizes_disagree_is_refused(kind: str, name: str, value: int) -> None:
    make, read = SOUND[kind]
    cloud = make()
    assert getattr(cloud, name) != value
    setattr(cloud, name, value)
    with pytest.raises(RefusedInput):
        read(cloud)


@pytest.mark.parametrize('kind', SOUND)
def test_a_cloud_with_more_data_than_points_is_refused(kind: str) -> None:
    make, read = SOUND[kind]
    cloud = make()
    cloud.data = cloud.data.tobytes() + b'\0'
    with pytest.raises(RefusedInput, match='expected one row') as refusal:
        read(cloud)
    assert refusal.value.cause == 'wrong_size'


@pytest.mark.parametrize('kind', SOUND)
@pytest.mark.parametrize('datatype', [0, 9, 255, PointField.INT8, PointField.FLOAT64])
def test_a_field_of_another_type_is_refused(kind: str, datatype: int) -> None:
    make, read = SOUND[kind]
    cloud = make()
    field = next(field for field in cloud.fields if field.datatype in (PointField.FLOAT32, PointField.UINT32))
    field.datatype = datatype
    with pytest.raises(RefusedInput) as refusal:
        read(cloud)
    assert refusal.value.cause == 'wrong_fields'


@pytest.mark.parametrize('kind', SOUND)
def test_a_field_that_occurs_twice_is_refused(kind: str) -> None:
    make, read = SOUND[kind]
    cloud = make()
    cloud.fields = [*cloud.fields, cloud.fields[0]]
    with pytest.raises(RefusedInput, match='missing or repeated'):
        read(cloud)


def test_other_fields_are_allowed_within_a_point_only() -> None:
    cloud = embedding_message(Embedding(1, MEAN, MEAN, MODEL), 'radar')
    cloud.fields = [PointField(name='extra', offset=4, datatype=PointField.FLOAT32, count=1), *cloud.fields]
    np.testing.assert_array_equal(embedding_record(cloud, 'embedding').mean, MEAN)
    for offset, count in ((cloud.point_step - 3, 1), (0, 2**29), (2**31 - 4, 1)):
        cloud.fields[0].offset, cloud.fields[0].count = offset, count
        with pytest.raises(RefusedInput, match='does not fit a point'):
            embedding_record(cloud, 'embedding')


def test_a_cloud_of_very_many_fields_is_refused() -> None:
    cloud = PointCloud2(height=1, fields=[PointField(name=str(i), count=1, datatype=2) for i in range(MAX_FIELDS + 1)])
    with pytest.raises(RefusedInput, match=f'expected at most {MAX_FIELDS}'):
        from_cloud(cloud, POINT, 'embedding')
    with pytest.raises(RefusedInput, match=f'{MAX_POINT_BYTES + 1} bytes'):
        from_cloud(PointCloud2(point_step=MAX_POINT_BYTES + 1), POINT, 'embedding')


def test_an_empty_map_of_a_huge_dimension_is_refused() -> None:
    """It takes no data, but the memory for the first place would be allocated."""
    cloud = descriptors_message(PlaceRows(PlaceTable.from_places([], 4), MODEL, committed=True), 1)
    cloud.fields[-1].count, cloud.point_step = MAX_DIMENSION + 1, MAX_POINT_BYTES
    with pytest.raises(RefusedInput, match='field embedding'):
        descriptors_record(cloud, 'map/descriptors')


def test_an_embedding_longer_than_any_encoders_is_refused() -> None:
    with pytest.raises(RefusedInput, match=f'expected at most {MAX_DIMENSION}') as refusal:
        embedding_record(PointCloud2(height=1, width=MAX_DIMENSION + 1), 'embedding')
    assert refusal.value.cause == 'wrong_size'


@pytest.mark.parametrize('kind', ['embedding', 'signed embedding', 'descriptors'])
def test_points_of_several_models_are_refused(kind: str) -> None:
    make, read = SOUND[kind]
    cloud = make()
    at = next(field.offset for field in cloud.fields if field.name == 'model')
    cloud.data[cloud.point_step + at] ^= 1
    with pytest.raises(RefusedInput, match='of one model'):
        read(cloud)


def test_places_that_are_partly_committed_are_refused() -> None:
    cloud = SOUND['descriptors'][0]()
    at = next(field.offset for field in cloud.fields if field.name == 'committed')
    cloud.data[cloud.point_step + at] = 0
    with pytest.raises(RefusedInput, match='got both'):
        descriptors_record(cloud, 'map/updates')


def test_only_the_message_that_names_the_file_means_the_file() -> None:
    assert not is_read_the_file(PointCloud2(fields=[PointField(name='read_the_file')] * 100_000))


if __name__ == '__main__':
    print(*try_all(sys.argv[1]))
