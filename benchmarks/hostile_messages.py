"""Messages that no honest node sends, for every input of the nodes: one seed gives the same messages again.

Each is a sound message with a few values replaced by hostile ones of their type, or its serialised bytes with some of
them changed. Some of them are still sound. Bytes between the fields of serialised ones are as the middleware leaves
them, and differ from time to time.
"""

from __future__ import annotations

import array
import copy
import dataclasses
import json
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sample_signatures import packed_signature
from sensor_msgs.msg import Image, NavSatFix, NavSatStatus, PointCloud2

from offradar_ros.alignment.signature_code import checksum_of
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.place_message import PlaceRows, descriptors_message, read_the_file_message
from offradar_ros.ros.signatures_message import signatures_message, wanted_message
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding, Place, PlaceTable, Pose, ScanKey

INTEGERS = (0, 1, -1, 2, 3, 8, 127, 255, 999_999_999, 10**9)
POWERS = (7, 8, 15, 16, 20, 24, 28, 29, 30, 31, 32, 62, 63, 64)
FLOATS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 3.4e38, 1e19, 5e-324, 0.0, -0.0, 1e-30, 999.0, -999.0)
LONG_TEXT = 2**20
LARGEST_LIST = 2**23
"""Most bytes of a list that is repeated: such a message may be repeated itself."""
TEXTS = (
    '',
    'x' * LONG_TEXT,
    '\n\r\t\x1b[31m',
    '\ufffd\u202e\U0001f4a3',
    '9' * 5000,
    '-1',
    '1e999',
    'NaN',
    '0' * 64,
    'ab' * 32,
    'g' * 64,
    '1000000000000',
    '{"a": "\\ud800"}',
    '{"a": ' * 1000 + '1' + '}' * 1000,
    '[' * 200_000,
    json.dumps({str(i): 'x' for i in range(10_000)}),
    '[]',
    'null',
)


class Hostile(NamedTuple):
    """One message: an object of type `kind`, or the serialised bytes of one that were changed."""

    topic: str
    kind: type
    message: Any
    profile: QoSProfile


class Input(NamedTuple):
    """An input of the nodes; `make` gives a sound message, as another for each number."""

    topic: str
    kind: type
    profile: QoSProfile
    make: Callable[[int], Any]


def inputs(model: ModelInfo, start_ns: int) -> tuple[Input, ...]:
    """Every input of the nodes, with messages of this model and stamps from `start_ns` on."""

    def stamp(number: int) -> int:
        return start_ns + number * 250_000_000

    def image(number: int) -> Image:
        power = np.random.default_rng(number).integers(1, 200, (400, 576), np.uint8)
        data = array.array('B', power.tobytes())
        about = header(stamp(number), 'radar')
        return Image(header=about, height=400, width=576, step=576, encoding='8UC1', data=data)

    def embedding(number: int) -> PointCloud2:
        one = _embedding(model, stamp(number), number)
        signature = packed_signature(number) if number % 2 else b''
        return embedding_message(dataclasses.replace(one, signature=signature), 'radar')

    def rows(number: int, *, committed: bool) -> PointCloud2:
        if committed and number % 10 == 0:
            return read_the_file_message(stamp(number))
        table = _places(model, number)
        signatures = tuple(packed_signature(number) for _ in range(len(table)))
        sent = {'checksums': tuple(map(checksum_of, signatures))} if committed else {'signatures': signatures}
        return descriptors_message(PlaceRows(table, model.fingerprint, committed, **sent), stamp(number))

    def scans(number: int) -> list[ScanKey]:
        return [ScanKey(1, row + 1) for row in range(1 + number % 4)]

    def signatures(number: int) -> PointCloud2:
        return signatures_message({scan: packed_signature(number) for scan in scans(number)}, stamp(number))

    def fix(number: int) -> NavSatFix:
        status = NavSatStatus(status=NavSatStatus.STATUS_FIX)
        about = header(stamp(number), 'gps')
        return NavSatFix(header=about, status=status, latitude=51.75, longitude=-1.25 + number * 1e-5, altitude=70.0)

    def odometry(number: int) -> Odometry:
        message = Odometry(header=header(stamp(number), 'odom'))
        message.pose.pose.position.x = float(number)
        return message

    return (
        Input('radar_data/b_scan_image', Image, qos.SCANS, image),
        Input('embedding', PointCloud2, qos.RESULTS, embedding),
        Input('embedding/model', DiagnosticStatus, qos.LATCHED, lambda _: model_message(model)),
        Input('map/descriptors', PointCloud2, qos.LATCHED, lambda number: rows(number, committed=True)),
        Input('map/updates', PointCloud2, qos.UPDATES, lambda number: rows(number, committed=False)),
        Input('map/signatures', PointCloud2, qos.RESULTS, signatures),
        Input('map/signatures_wanted', PointCloud2, qos.RESULTS, lambda n: wanted_message(scans(n), stamp(n))),
        Input('gps/fix', NavSatFix, qos.POSITIONS, fix),
        Input('odometry', Odometry, qos.POSITIONS, odometry),
        Input('ground_truth/odometry', Odometry, qos.POSITIONS, odometry),
    )


def hostile_messages(seed: int, model: ModelInfo, start_ns: int, changed_bytes: float = 0.2) -> Iterator[Hostile]:
    """Endless messages, the inputs in turn; `changed_bytes` is the share of serialised ones."""
    rng = np.random.default_rng(seed)
    known, number = inputs(model, start_ns), 0
    while True:
        for one in known:
            message = one.make(number)
            if rng.random() < changed_bytes:
                yield Hostile(one.topic, one.kind, _flipped(serialize_message(message), rng), one.profile)
            else:
                for _ in range(int(rng.integers(1, 4))):
                    _spoil(message, rng)
                yield Hostile(one.topic, one.kind, message, one.profile)
        number += 1


def _embedding(model: ModelInfo, stamp_ns: int, number: int) -> Embedding:
    mean = np.random.default_rng(number).normal(size=model.dimension).astype(np.float32)
    return Embedding(stamp_ns, mean, np.ones(model.dimension, np.float32), model.fingerprint)


def _places(model: ModelInfo, number: int) -> PlaceTable:
    places = [
        Place(i, 1, i + 1, Pose(10.0 * i, 0.0), 1.0, _embedding(model, i, number + i).mean) for i in range(number % 4)
    ]
    return PlaceTable.from_places(places, model.dimension)


def _spoil(message: Any, rng: np.random.Generator) -> None:
    """Replace one value somewhere in a message."""
    types: dict[str, str] = message.get_fields_and_field_types()
    name = str(rng.choice(list(types)))
    value, kind = getattr(message, name), types[name]
    if hasattr(value, 'get_fields_and_field_types'):
        _spoil(value, rng)
    elif isinstance(value, list) and value and rng.random() < 0.7:
        # A field of a cloud, or a value of a status.
        _spoil(value[int(rng.integers(len(value)))], rng)
    else:
        setattr(message, name, _hostile(value, kind, rng))


def _hostile(value: Any, kind: str, rng: np.random.Generator) -> Any:
    if isinstance(value, list):
        if rng.random() < 0.5:
            return value[: int(rng.integers(len(value) + 1))]
        most = LARGEST_LIST // (sum(len(serialize_message(each)) for each in value) + 1)
        return [copy.deepcopy(each) for _ in range(min(int(rng.integers(2, 500)), most)) for each in value]
    if isinstance(value, array.array):
        length = int(rng.integers(3))
        return value[: [0, len(value) // 2, len(value)][length]] + array.array('B', rng.bytes(length))
    if isinstance(value, np.ndarray):
        return np.full_like(value, rng.choice(FLOATS))
    if isinstance(value, bool):
        return not value
    if isinstance(value, bytes):
        return rng.bytes(1)
    if isinstance(value, str):
        return TEXTS[int(rng.integers(len(TEXTS)))]
    if isinstance(value, float):
        return float(rng.choice(FLOATS))
    return _integer(kind, rng)


def _integer(kind: str, rng: np.random.Generator) -> int:
    bits = int(kind.removeprefix('u').removeprefix('int'))
    least, most = (0, 2**bits) if kind.startswith('u') else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    value = 2 ** int(rng.choice(POWERS)) + int(rng.integers(-8, 9))
    if rng.random() < 0.3:
        value = int(rng.choice(INTEGERS))
    elif rng.random() < 0.2:
        value = -value
    return int(min(max(value, least), most - 1))


def _flipped(cdr: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(cdr)
    # Most of a large message is data: its beginning says what it is.
    for _ in range(int(rng.integers(1, 9))):
        changed[int(rng.integers(4, min(len(changed), 600)))] = int(rng.integers(256))
    if rng.random() < 0.2:
        del changed[int(rng.integers(4, len(changed))) :]
    return bytes(changed)
