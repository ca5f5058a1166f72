"""Reads ONNX files without the onnx package: metadata entries, references to other files, and single precision.

An ONNX file is a protocol buffer, `ModelProto` of onnx.proto. A message is a sequence of fields, each a key (number · 8
+ wire type, a varint) and a value. Nested messages, strings and bytes have wire type 2 and start with their length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5

# Field numbers in ModelProto, GraphProto, StringStringEntryProto and TensorProto.
_GRAPH, _METADATA = 7, 14
_INITIALIZER = 5
_KEY, _VALUE = 1, 2
_DATA_TYPE, _RAW_DATA, _EXTERNAL_DATA, _DATA_LOCATION = 2, 9, 13, 14
_FLOAT, _FLOAT16 = 1, 10

_TENSOR = 'tensor'
_HOLDS = {
    'model': {_GRAPH: 'graph', 20: 'training', 25: 'function'},
    'training': {1: 'graph', 2: 'graph'},
    'graph': {1: 'node', _INITIALIZER: _TENSOR, 15: 'sparse'},
    'function': {7: 'node', 11: 'attribute'},
    'node': {5: 'attribute'},
    'attribute': {5: _TENSOR, 6: 'graph', 10: _TENSOR, 11: 'graph', 22: 'sparse', 23: 'sparse'},
    'sparse': {1: _TENSOR, 2: _TENSOR},
}
"""Messages of onnx.proto that lead to a tensor: what a message holds in which field."""
_DEEPEST = 32

Field = tuple[int, int, 'int | memoryview']
"""Number, wire type and value of a field."""


def read_metadata(content: bytes) -> dict[str, str]:
    """Metadata entries of an ONNX file; ValueError if it is not ONNX."""
    found = {}
    for number, _, value in _fields(memoryview(content)):
        if number == _METADATA and isinstance(value, memoryview):
            entry = {key: bytes(text).decode() for key, _, text in _fields(value) if isinstance(text, memoryview)}
            if _KEY not in entry or _VALUE not in entry:
                raise ValueError('a metadata entry without key or value')
            found[entry[_KEY]] = entry[_VALUE]
    return found


def metadata_entry(key: str, value: str) -> bytes:
    """The bytes that add a metadata entry to an ONNX file when they are appended to it."""
    pair: list[Field] = [(_KEY, _BYTES, memoryview(key.encode())), (_VALUE, _BYTES, memoryview(value.encode()))]
    return _message([(_METADATA, _BYTES, memoryview(_message(pair)))])


def has_external_data(content: bytes) -> bool:
    """Whether any tensor of an ONNX file lies in another file; ValueError if it is not ONNX."""
    return _leads_outside(memoryview(content), 'model', 0)


def in_single_precision(content: bytes) -> bytes:
    """The content of a file with half-precision weights as float32, for runtimes without half precision.

    ValueError if it is not ONNX.
    """
    return _message(
        (number, kind, memoryview(_message(map(_widened_in_graph, _fields(value)))) if number == _GRAPH else value)
        if isinstance(value, memoryview)
        else (number, kind, value)
        for number, kind, value in _fields(memoryview(content))
    )


def _leads_outside(message: memoryview, kind: str, depth: int) -> bool:
    if depth > _DEEPEST:
        raise ValueError(f'graphs within graphs, deeper than {_DEEPEST} levels')
    for number, _, value in _fields(message):
        if kind == _TENSOR:
            if number == _EXTERNAL_DATA or (number == _DATA_LOCATION and value != 0):
                return True
        elif (
            number in _HOLDS[kind]
            and isinstance(value, memoryview)
            and _leads_outside(value, _HOLDS[kind][number], depth + 1)
        ):
            return True
    return False


def _widened_in_graph(field: Field) -> Field:
    number, kind, value = field
    if number != _INITIALIZER or not isinstance(value, memoryview):
        return field
    tensor = list(_fields(value))
    if (_DATA_TYPE, _VARINT, _FLOAT16) not in tensor:
        return field
    widened: list[Field] = []
    for inner in tensor:
        if inner[0] == _DATA_TYPE:
            widened.append((_DATA_TYPE, _VARINT, _FLOAT))
        elif inner[0] == _RAW_DATA and isinstance(inner[2], memoryview):
            wide = np.frombuffer(inner[2], '<f2').astype('<f4').tobytes()
            widened.append((_RAW_DATA, _BYTES, memoryview(wide)))
        else:
            widened.append(inner)
    return number, kind, memoryview(_message(widened))


def _fields(message: memoryview) -> Iterator[Field]:
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


def _varint(message: memoryview, place: int) -> tuple[int, int]:
    """A number in groups of 7 bits, the lowest first, and the index after it."""
    number = shift = 0
    while place < len(message) and shift < 64:
        byte = message[place]
        number |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return number, place
    raise ValueError('not a protocol buffer, or truncated')


def _message(fields: Iterable[Field]) -> bytes:
    """The serialised message of these fields."""
    parts = bytearray()
    for number, kind, value in fields:
        parts += _varint_bytes(number << 3 | kind)
        if isinstance(value, int):
            parts += _varint_bytes(value)
        else:
            parts += _varint_bytes(len(value)) if kind == _BYTES else b''
            parts += value
    return bytes(parts)


def _varint_bytes(number: int) -> bytes:
    groups = bytearray()
    while number >= 0x80:
        groups.append(number & 0x7F | 0x80)
        number >>= 7
    groups.append(number)
    return bytes(groups)
