"""Embedding ↔ PointCloud2 of d points, and its model ↔ DiagnosticStatus.

Every embedding names its model by the full SHA-256, so that no receiver depends on the order of two topics. For the
same reason the signature of the scan travels with it, in a further field. That field's bytes of all points, one after
the other, are the number of bytes of the signature in two bytes, little endian, then the signature, then zeroes.
"""

from __future__ import annotations

import json
import re

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from offradar_ros.alignment.signature_code import unpack
from offradar_ros.bounded_input import parse_json
from offradar_ros.encoders.protocol import MAX_DIMENSION, ModelInfo
from offradar_ros.errors import ModelError, RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.ros.clouds import MAX_FIELDS, Layout, from_cloud, to_cloud
from offradar_ros.ros.stamps import header
from offradar_ros.types import MAX_SIGNATURE_BYTES, Embedding

POINT = np.dtype([('mean', '<f4'), ('variance', '<f4'), ('model', 'u1', (32,))])
SIGNATURE = 'signature'
_LENGTH_BYTES = 2

MAX_FRAME_ID_CHARACTERS = 256
"""More of a scan's frame is not repeated in its embedding: no frame of a robot has a longer name."""

MAX_METADATA_BYTES = 2**20
"""Longest JSON of a model's metadata: all of its characters may be escaped."""

MAX_VALUES = 64
"""Most key-value pairs in a message about a model."""

_DIMENSION = re.compile('[0-9]{1,9}')


def embedding_message(embedding: Embedding, frame_id: str) -> PointCloud2:
    """Width d; 0 for a scan that could not be encoded."""
    dimension, signature = len(embedding.mean), embedding.signature
    is_signed = bool(signature) and dimension > 0
    columns = _columns(len(signature), dimension) if is_signed else 0
    points = np.empty(dimension, _signed(columns) if is_signed else POINT)
    points['mean'], points['variance'] = embedding.mean, embedding.variance
    points['model'] = np.frombuffer(bytes.fromhex(embedding.model), np.uint8)
    if is_signed:
        content = len(signature).to_bytes(_LENGTH_BYTES, 'little') + signature
        points[SIGNATURE] = np.frombuffer(content.ljust(dimension * columns, b'\0'), np.uint8).reshape(-1, columns)
    return to_cloud(points, header(embedding.stamp_ns, frame_id[:MAX_FRAME_ID_CHARACTERS]))


def embedding_record(message: PointCloud2, topic: str) -> Embedding:
    """The embedding in a message.

    RefusedInput: `wrong_size`, `wrong_fields` or `short_data` if its fields are not those of an embedding of one model,
    `invalid_signature` if what is in the field of the signature is none. Without that field it has no signature.
    """
    stamp = stamp_ns(message.header.stamp)
    dimension = int(message.width)
    if dimension > MAX_DIMENSION:
        raise RefusedInput('wrong_size', f'{topic}: dimension {dimension}: expected at most {MAX_DIMENSION}')
    is_signed = any(field.name == SIGNATURE for field in message.fields[:MAX_FIELDS])
    most = _columns(MAX_SIGNATURE_BYTES, dimension)
    points = from_cloud(message, _signed(1) if is_signed else POINT, topic, {SIGNATURE: most})
    return Embedding(
        stamp,
        points['mean'].astype(np.float32),
        points['variance'].astype(np.float32),
        fingerprint_of(points['model'], topic),
        _signature(points[SIGNATURE], topic) if is_signed and dimension else b'',
    )


def _signed(columns: int) -> Layout:
    """A point with so many bytes of the signature."""
    return np.dtype([*POINT.descr, (SIGNATURE, 'u1', (columns,))])


def _columns(size: int, dimension: int) -> int:
    """Bytes in each of d points for a signature of `size` bytes and its length."""
    return -(-(_LENGTH_BYTES + size) // max(dimension, 1))


def _signature(rows: NDArray[np.uint8], topic: str) -> bytes:
    """The signature in the (d, C) bytes of the points."""
    content = rows.tobytes()
    size = int.from_bytes(content[:_LENGTH_BYTES], 'little')
    end = _LENGTH_BYTES + size
    if not 0 < size <= MAX_SIGNATURE_BYTES or rows.shape[1] != _columns(size, len(rows)) or any(content[end:]):
        raise RefusedInput(
            'invalid_signature',
            f'{topic}: a signature of {size} bytes in {len(rows)} points of {rows.shape[1]}: expected 1 to '
            f'{MAX_SIGNATURE_BYTES} bytes in as few columns as hold them, and zeroes after them',
        )
    signature = content[_LENGTH_BYTES:end]
    try:
        unpack(signature)
    except RefusedInput as problem:
        raise RefusedInput(problem.cause, f'{topic}: {problem}') from None
    return signature


def fingerprint_of(models: NDArray[np.uint8], topic: str) -> str:
    """The fingerprint that (N, 32) points name, all of them the same one; empty for no points."""
    if not len(models):
        return ''
    if (models != models[0]).any():
        raise RefusedInput('wrong_fields', f'{topic}: expected points of one model, got several')
    fingerprint: str = models[0].tobytes().hex()
    return fingerprint


def model_message(info: ModelInfo) -> DiagnosticStatus:
    """Name, fingerprint, dimension and metadata of a model."""
    values = {
        'fingerprint': info.fingerprint,
        'dimension': str(info.dimension),
        'metadata': json.dumps(dict(info.metadata)),
    }
    return DiagnosticStatus(
        level=DiagnosticStatus.OK,
        name=info.name,
        message=f'{info.name}, d = {info.dimension}',
        hardware_id=info.fingerprint,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def model_record(message: DiagnosticStatus, topic: str) -> ModelInfo:
    """The model in a message; RefusedInput: 'wrong_fields' if it is not one, 'invalid_model' if it is not valid."""
    few = message.values[: MAX_VALUES + 1]
    values = {item.key: item.value for item in few} if len(few) <= MAX_VALUES else {}
    try:
        metadata = parse_json(values['metadata'], MAX_METADATA_BYTES)
        if not isinstance(metadata, dict) or not _DIMENSION.fullmatch(values['dimension']):
            raise ValueError
        return ModelInfo(message.name, values['fingerprint'], int(values['dimension']), metadata)
    except ModelError as error:
        raise RefusedInput('invalid_model', f'{topic}: {error}') from error
    except (KeyError, ValueError) as error:
        raise RefusedInput(
            'wrong_fields', f'{topic}: expected fingerprint, dimension and metadata of a model'
        ) from error
