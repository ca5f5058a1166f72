"""Reads ONNX files without the onnx package: metadata entries, and weights in single precision.

An ONNX file is a protocol buffer, `ModelProto` of onnx.proto. A message is a sequence of fields, each a key (number · 8
+ wire type, a varint) and a value. Nested messages, strings and bytes have wire type 2 and start with their length.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from offradar_ros.encoders.model_files import require_file
from offradar_ros.errors import ModelError

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5

# Field numbers in ModelProto, GraphProto, StringStringEntryProto and TensorProto.
_GRAPH, _METADATA = 7, 14
_INITIALIZER = 5
_KEY, _VALUE = 1, 2
_DATA_TYPE, _RAW_DATA = 2, 9
_FLOAT, _FLOAT16 = 1, 10

Field = tuple[int, int, int | bytes]
"""Number, wire type and value of a field."""


def read_metadata(path: str | Path) -> dict[str, str]:
    """Metadata entries of an ONNX file; ModelError for a file that is missing or not ONNX."""
    found = {}
    try:
        for number, _, value in _fields(_content(path)):
            if number == _METADATA and isinstance(value, bytes):
                entry = {key: text for key, _, text in _fields(value) if isinstance(text, bytes)}
                found[entry[_KEY].decode()] = entry[_VALUE].decode()
    except (ValueError, KeyError) as error:
        raise ModelError(f'{path}: not a readable ONNX file ({error})') from error
    return found


def read_in_single_precision(path: str | Path) -> bytes:
    """The content of a file with half-precision weights as float32, for runtimes without half precision.

    ModelError as `read_metadata`.
    """
    try:
        model = list(_fields(_content(path)))
        return _message(
            (number, kind, _message(map(_widened_in_graph, _fields(value))) if number == _GRAPH else value)
            if isinstance(value, bytes)
            else (number, kind, value)
            for number, kind, value in model
        )
    except (ValueError, KeyError) as error:
        raise ModelError(f'{path}: not a readable ONNX file ({error})') from error


def _content(path: str | Path) -> bytes:
    return Path(require_file(path)).read_bytes()


def _widened_in_graph(field: Field) -> Field:
    number, kind, value = field
    if number != _INITIALIZER or not isinstance(value, bytes):
        return field
    tensor = list(_fields(value))
    if (_DATA_TYPE, _VARINT, _FLOAT16) not in tensor:
        return field
    widened: list[Field] = []
    for inner in tensor:
        if inner[0] == _DATA_TYPE:
            widened.append((_DATA_TYPE, _VARINT, _FLOAT))
        elif inner[0] == _RAW_DATA and isinstance(inner[2], bytes):
            widened.append((_RAW_DATA, _BYTES, np.frombuffer(inner[2], '<f2').astype('<f4').tobytes()))
        else:
            widened.append(inner)
    return number, kind, _message(widened)


def _fields(message: bytes) -> Iterator[Field]:
    """Fields of a message in order; ValueError if it is truncated or not a message."""
    place = 0
    while place < len(message):
        key, place = _varint(message, place)
        kind = key & 7
        if kind == _VARINT:
            value, place = _varint(message, place)
            yield key >> 3, kind, value
            continue
        length = {_FIXED64: 8, _FIXED32: 4}.get(kind)
        if kind == _BYTES:
            length, place = _varint(message, place)
        if length is None or place + length > len(message):
            raise ValueError('not a protocol buffer, or truncated')
        yield key >> 3, kind, message[place : place + length]
        place += length


def _varint(message: bytes, place: int) -> tuple[int, int]:
    """A number in groups of 7 bits, the lowest first, and the index after it."""
    number = shift = 0
    while place < len(message) and shift < 64:
        byte = message[place]
        number |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return number, place
    raise ValueError('not a protocol buffer, or truncated')


def _message(fields: Iterator[Field] | list[Field] | map[Field]) -> bytes:
    """The serialised message of these fields."""
    parts = bytearray()
    for number, kind, value in fields:
        parts += _varint_bytes(number << 3 | kind)
        if isinstance(value, int):
            parts += _varint_bytes(value)
        else:
            parts += (_varint_bytes(len(value)) if kind == _BYTES else b'') + value
    return bytes(parts)


def _varint_bytes(number: int) -> bytes:
    groups = bytearray()
    while number >= 0x80:
        groups.append(number & 0x7F | 0x80)
        number >>= 7
    groups.append(number)
    return bytes(groups)
