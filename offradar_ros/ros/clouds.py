"""Structured arrays as PointCloud2, which any ROS 2 machine can record, echo and plot without this package."""

from __future__ import annotations

import array
from collections.abc import Sequence
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
_FORMATS = {datatype: f'<{code}' for code, datatype in _DATATYPES.items()}


def to_cloud(points: NDArray[Any], header: Header) -> PointCloud2:
    """(N,) structured array → an unordered cloud of N points, one field a column (sub-arrays keep their count)."""
    fields = []
    for name in points.dtype.names or ():
        dtype, offset = points.dtype.fields[name][:2]  # type: ignore[index]
        fields.append(
            PointField(
                name=name,
                offset=int(offset),
                datatype=_DATATYPES[dtype.base.str[1:]],
                count=int(np.prod(dtype.shape, dtype=int)),
            )
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


def from_cloud(cloud: PointCloud2, required: Sequence[str], topic: str) -> NDArray[Any]:
    """A cloud's points as a structured array; RefusedInput('wrong_fields' | 'short_data') names the topic."""
    names = [field.name for field in cloud.fields]
    missing = [name for name in required if name not in names]
    if missing:
        raise RefusedInput(
            'wrong_fields', f'{topic}: expected fields {", ".join(required)}, missing {", ".join(missing)}'
        )
    count = int(cloud.width) * int(cloud.height)
    if cloud.is_bigendian or len(cloud.data) < count * cloud.point_step:
        raise RefusedInput(
            'short_data',
            f'{topic}: expected {count} little-endian points of {cloud.point_step} bytes, got {len(cloud.data)} bytes',
        )
    try:
        dtype = np.dtype(
            {
                'names': names,
                'formats': [
                    (_FORMATS[field.datatype], (field.count,)) if field.count > 1 else _FORMATS[field.datatype]
                    for field in cloud.fields
                ],
                'offsets': [field.offset for field in cloud.fields],
                'itemsize': cloud.point_step,
            }
        )
    except (KeyError, ValueError) as error:
        raise RefusedInput('wrong_fields', f'{topic}: fields do not fit a point of {cloud.point_step} bytes') from error
    return np.frombuffer(cloud.data, dtype, count)
