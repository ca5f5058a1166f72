"""Structured arrays as PointCloud2, which any ROS 2 machine can record, echo and plot without this package.

A cloud describes its own layout. NumPy keeps sizes and offsets in 32 bits, so no description reaches it before it has
been compared, in Python's integers, with the layout that is expected.
"""

from __future__ import annotations

import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from offradar_ros.errors import RefusedInput

_DATATYPES = {
    'i1': PointField.INT8,
    'u1': PointField.UINT8,
    'i2': PointField.INT16,
    'u2': PointField.UINT16,
    'i4': PointField.INT32,
    'u4': PointField.UINT32,
    'f4': PointField.FLOAT32,
    'f8': PointField.FLOAT64,
}
_SIZES = {datatype: int(code[1:]) for code, datatype in _DATATYPES.items()}

MAX_FIELDS = 64
"""Most fields of a point: ours have at most fifteen."""

MAX_POINT_BYTES = 2**20
"""Largest point: a place with the largest embedding has a quarter of it."""

Layout = np.dtype[np.void]


def to_cloud(points: NDArray[Any], header: Header) -> PointCloud2:
    """(N,) structured array → an unordered cloud of N points, one field a column (sub-arrays keep their count)."""
    fields = []
    for name in points.dtype.names or ():
        dtype, offset = points.dtype.fields[name][:2]  # type: ignore[index]
        fields.append(
            PointField(name=name, offset=int(offset), datatype=_DATATYPES[dtype.base.str[1:]], count=_count(dtype))
        )
    data = array.array('B')
    # PointCloud2 checks every element of anything but an array.array, at 170 ms a megabyte.
    data.frombytes(np.ascontiguousarray(points).view(np.uint8).data)
    return PointCloud2(
        header=header,
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * len(points),
        data=data,
        is_dense=True,
    )


def from_cloud(
    cloud: PointCloud2, layout: Layout, topic: str, max_counts: Mapping[str, int] | None = None
) -> NDArray[Any]:
    """A cloud's points as (N,) structured array with the fields of `layout`, whatever their order and offsets.

    Every field of the layout must be there once, with its type and count; other fields are allowed within the point,
    and left out.

    Args:
        cloud: one row of points.
        layout: names, types and counts of the fields.
        topic: for the error.
        max_counts: fields of the layout that may have any count from 1 to this one instead.

    Raises RefusedInput (`wrong_fields`, `short_data`, `wrong_size`), which names the topic.
    """
    free = max_counts or {}
    offsets, counts = _checked_fields(cloud, layout, topic, free)
    points = _checked_size(cloud, topic)
    names = layout.names or ()
    base = {name: layout[name].base for name in names}
    dtype = np.dtype(
        {
            'names': list(names),
            'formats': [(base[n], (counts[n],)) if layout[n].shape or n in free else base[n] for n in names],
            'offsets': [offsets[n] for n in names],
            'itemsize': int(cloud.point_step),
        }
    )
    return np.frombuffer(cloud.data, dtype, points) if points else np.empty(0, dtype)


def _count(dtype: np.dtype[Any]) -> int:
    return int(np.prod(dtype.shape, dtype=int))


def _checked_fields(
    cloud: PointCloud2, layout: Layout, topic: str, max_counts: Mapping[str, int]
) -> tuple[dict[str, int], dict[str, int]]:
    """Offsets and counts of the fields of the layout, within a point of bounded size."""
    expected = layout.names or ()
    step = int(cloud.point_step)
    if len(cloud.fields) > MAX_FIELDS or step > MAX_POINT_BYTES:
        raise RefusedInput(
            'wrong_fields',
            f'{topic}: {len(cloud.fields)} fields in a point of {step} bytes: expected at most {MAX_FIELDS} in '
            f'{MAX_POINT_BYTES}',
        )
    found = [field.name for field in cloud.fields]
    missing = [name for name in expected if found.count(name) != 1]
    if missing:
        raise RefusedInput(
            'wrong_fields',
            f'{topic}: expected fields {", ".join(expected)}, missing or repeated {", ".join(missing)}',
        )
    offsets, counts = {}, {}
    for field in cloud.fields:
        name, offset, datatype, count = field.name, int(field.offset), int(field.datatype), int(field.count)
        size = _SIZES.get(datatype, 0)
        # Some publishers write a count of 0 for a scalar: it takes the space of one.
        if not size or offset < 0 or count < 0 or offset + size * max(count, 1) > step:
            raise RefusedInput(
                'wrong_fields',
                f'{topic}: a field of type {datatype}, count {count}, at {offset} does not fit a point of {step} bytes',
            )
        if name not in expected:
            continue
        fits = 1 <= count <= max_counts[name] if name in max_counts else count == _count(layout[name])
        if datatype != _DATATYPES[layout[name].base.str[1:]] or not fits:
            raise RefusedInput('wrong_fields', f'{topic}: field {name} has type {datatype} and count {count}: not ours')
        offsets[name], counts[name] = offset, count
    return offsets, counts


def _checked_size(cloud: PointCloud2, topic: str) -> int:
    """The number of points, which all sizes of the cloud agree on."""
    points, step, size = int(cloud.width), int(cloud.point_step), len(cloud.data)
    if cloud.is_bigendian or size < points * step:
        raise RefusedInput(
            'short_data', f'{topic}: expected {points} little-endian points of {step} bytes, got {size} bytes'
        )
    if int(cloud.height) != 1 or int(cloud.row_step) != points * step or size != points * step:
        raise RefusedInput(
            'wrong_size',
            f'{topic}: expected one row of {points} points of {step} bytes, got {int(cloud.height)} rows of '
            f'{int(cloud.row_step)} bytes and {size} bytes in all',
        )
    return points
