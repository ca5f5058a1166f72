"""PlaceTable ↔ PointCloud2, for the search and for display."""

from __future__ import annotations

import dataclasses

import numpy as np
from sensor_msgs.msg import PointCloud2

from offradar_ros.ros.clouds import from_cloud, to_cloud
from offradar_ros.ros.stamps import header
from offradar_ros.types import PlaceTable

MAP_FRAME = 'map'


@dataclasses.dataclass(frozen=True)
class PlaceRows:
    """Rows of the map in a message: of one model, committed or of the running session."""

    table: PlaceTable
    model: str
    committed: bool


def descriptors_message(rows: PlaceRows, stamp_ns: int) -> PointCloud2:
    """Everything that the search needs: position (float64), uncertainty, provenance, embedding[d] and model."""
    table = rows.table
    dimension = table.means.shape[1]
    points = np.empty(
        len(table),
        np.dtype(
            [
                ('x', '<f8'),
                ('y', '<f8'),
                ('z', '<f8'),
                ('yaw', '<f8'),
                ('uncertainty', '<f4'),
                ('place_id', '<u4'),
                ('session_id', '<u4'),
                ('stamp_sec', '<i4'),
                ('stamp_nanosec', '<u4'),
                ('committed', 'u1'),
                ('model', 'u1', (32,)),
                ('embedding', '<f4', (dimension,)),
            ]
        ),
    )
    points['x'], points['y'], points['z'] = table.positions_m.T
    points['yaw'], points['uncertainty'] = table.yaws_rad, table.uncertainties
    points['place_id'], points['session_id'] = table.place_ids, table.session_ids
    points['stamp_sec'], points['stamp_nanosec'] = np.divmod(table.stamps_ns, 10**9)
    points['committed'] = rows.committed
    if len(points):
        points['model'] = np.frombuffer(bytes.fromhex(rows.model), np.uint8)
    points['embedding'] = table.means
    return to_cloud(points, header(stamp_ns, MAP_FRAME))


def descriptors_record(message: PointCloud2, topic: str) -> PlaceRows:
    """The rows in a message; RefusedInput if it is not one of ours."""
    required = ['x', 'y', 'z', 'yaw', 'uncertainty', 'place_id', 'session_id', 'stamp_sec', 'stamp_nanosec']
    points = from_cloud(message, [*required, 'committed', 'model', 'embedding'], topic)
    table = PlaceTable(
        place_ids=points['place_id'].astype(np.int64),
        session_ids=points['session_id'].astype(np.int32),
        stamps_ns=points['stamp_sec'].astype(np.int64) * 10**9 + points['stamp_nanosec'],
        positions_m=np.stack([points['x'], points['y'], points['z']], axis=1).astype(np.float64),
        yaws_rad=points['yaw'].astype(np.float64),
        uncertainties=points['uncertainty'].astype(np.float32),
        means=points['embedding']
        .astype(np.float32)
        .reshape(len(points), int(np.prod(points.dtype['embedding'].shape))),
    )
    model = points['model'][0].tobytes().hex() if len(points) else ''
    return PlaceRows(table, model, bool(len(points)) and bool(points['committed'][0]))


READ_THE_FILE = 'read_the_file'


def read_the_file_message(stamp_ns: int) -> PointCloud2:
    """Instead of descriptors: the map is too large for a message and is read from its file."""
    return to_cloud(np.empty(0, np.dtype([(READ_THE_FILE, 'u1')])), header(stamp_ns, MAP_FRAME))


def is_read_the_file(message: PointCloud2) -> bool:
    """Whether a message on `map/descriptors` points to the file."""
    return [field.name for field in message.fields] == [READ_THE_FILE]


def map_message(table: PlaceTable, stamp_ns: int) -> PointCloud2:
    """What RViz and Foxglove draw: x, y, z in float32, intensity = U, place_id."""
    points = np.empty(
        len(table),
        np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('place_id', '<u4')]),
    )
    points['x'], points['y'], points['z'] = table.positions_m.T
    points['intensity'], points['place_id'] = table.uncertainties, table.place_ids
    return to_cloud(points, header(stamp_ns, MAP_FRAME))
