"""PlaceTable ↔ PointCloud2, for the search and for display."""

from __future__ import annotations

import dataclasses

import numpy as np
from sensor_msgs.msg import PointCloud2

from offradar_ros.encoders.protocol import MAX_DIMENSION
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.place_check import MAX_SESSION_ID
from offradar_ros.ros.clouds import MAX_FIELDS, Layout, from_cloud, to_cloud
from offradar_ros.ros.embedding_message import fingerprint_of
from offradar_ros.ros.signature_rows import (
    MAX_COUNTS,
    SIGNATURE,
    read_signatures,
    require_sound,
    signed_layout,
    write_signatures,
)
from offradar_ros.ros.stamps import header
from offradar_ros.types import PlaceTable

MAP_FRAME = 'map'

VIEW = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('place_id', '<u4')])
"""A point of the view of the map."""

READ_THE_FILE = np.dtype([('read_the_file', 'u1')])
"""A point of a message that only says where the map is."""

CHECKSUM = 'signature_checksum'
"""The field that says which signature the scan of a place has."""


YAW_SD = 'yaw_sd'
"""The field of the standard deviations of headings, radians, NaN where unknown."""


def descriptors_layout(dimension: int) -> Layout:
    """A place as a point."""
    return np.dtype(
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
    )


@dataclasses.dataclass(frozen=True)
class PlaceRows:
    """Rows of the map in a message: of one model, committed or of the running session.

    Attributes:
        table: the rows.
        model: fingerprint of their model.
        committed: whether they are of an ended session.
        signatures: of the scans that the rows hold, packed, one a row, empty for a scan that has none; or none at all,
            as of a whole map, whose signatures would be many times its size.
        checksums: of those signatures (`checksum_of`), one a row, 0 for a scan that has none; or none at all.
    """

    table: PlaceTable
    model: str
    committed: bool
    signatures: tuple[bytes, ...] = ()
    checksums: tuple[int, ...] = ()


def descriptors_message(rows: PlaceRows, stamp_ns: int) -> PointCloud2:
    """Everything that the search needs: position (float64), uncertainty, provenance, embedding[d] and model.

    The fields of the standard deviation of headings, of signatures and of checksums are there if any row has one.
    """
    table = rows.table
    layout = descriptors_layout(table.means.shape[1])
    has_sds = not np.isnan(table.yaw_sds_rad).all()
    if has_sds:
        layout = _with(layout, YAW_SD, '<f4')
    if any(rows.checksums):
        layout = _with(layout, CHECKSUM, '<u4')
    if any(rows.signatures):
        layout = signed_layout(layout, rows.signatures)
    points = np.empty(len(table), layout)
    points['x'], points['y'], points['z'] = table.positions_m.T
    points['yaw'], points['uncertainty'] = table.yaws_rad, table.uncertainties
    points['place_id'], points['session_id'] = table.place_ids, table.session_ids
    points['stamp_sec'], points['stamp_nanosec'] = np.divmod(table.stamps_ns, 10**9)
    points['committed'] = rows.committed
    if len(points):
        points['model'] = np.frombuffer(bytes.fromhex(rows.model), np.uint8)
    points['embedding'] = table.means
    if has_sds:
        points[YAW_SD] = table.yaw_sds_rad
    if any(rows.checksums):
        points[CHECKSUM] = rows.checksums
    if any(rows.signatures):
        write_signatures(points, rows.signatures)
    return to_cloud(points, header(stamp_ns, MAP_FRAME))


def descriptors_record(message: PointCloud2, topic: str) -> PlaceRows:
    """The rows in a message; RefusedInput if it is not one of ours.

    Of the table, only what it cannot hold is checked here; the values of the places are checked where they are taken
    up. Signatures are sound, or refused with their rows.
    """
    names = {field.name for field in message.fields[:MAX_FIELDS]}
    layout, max_counts = descriptors_layout(1), {'embedding': MAX_DIMENSION}
    if YAW_SD in names:
        layout = _with(layout, YAW_SD, '<f4')
    if CHECKSUM in names:
        layout = _with(layout, CHECKSUM, '<u4')
    if SIGNATURE in names:
        layout, max_counts = signed_layout(layout), max_counts | MAX_COUNTS
    points = from_cloud(message, layout, topic, max_counts)
    if (points['stamp_nanosec'] >= 10**9).any() or (points['session_id'] > MAX_SESSION_ID).any():
        raise RefusedInput('invalid_place', f'{topic}: a place has no valid stamp or session id')
    if (points['committed'] != points['committed'][:1]).any():
        raise RefusedInput('wrong_fields', f'{topic}: expected either committed places or running ones, got both')
    table = PlaceTable(
        place_ids=points['place_id'].astype(np.int64),
        session_ids=points['session_id'].astype(np.int32),
        stamps_ns=points['stamp_sec'].astype(np.int64) * 10**9 + points['stamp_nanosec'],
        positions_m=np.stack([points['x'], points['y'], points['z']], axis=1).astype(np.float64),
        yaws_rad=points['yaw'].astype(np.float64),
        yaw_sds_rad=points[YAW_SD].astype(np.float32) if YAW_SD in names else np.full(len(points), np.nan, np.float32),
        uncertainties=points['uncertainty'].astype(np.float32),
        means=points['embedding'].astype(np.float32),
    )
    model = fingerprint_of(points['model'], topic)
    signatures = read_signatures(points, topic) if SIGNATURE in names else ()
    checksums = tuple(points[CHECKSUM].tolist()) if CHECKSUM in names else ()
    require_sound(signatures, topic)
    return PlaceRows(table, model, bool(len(points)) and bool(points['committed'][0]), signatures, checksums)


def _with(layout: Layout, name: str, kind: str) -> Layout:
    return np.dtype([*layout.descr, (name, kind)])


def read_the_file_message(stamp_ns: int) -> PointCloud2:
    """Instead of descriptors: the map is too large for a message and is read from its file."""
    return to_cloud(np.empty(0, READ_THE_FILE), header(stamp_ns, MAP_FRAME))


def is_read_the_file(message: PointCloud2) -> bool:
    """Whether a message on `map/descriptors` points to the file."""
    names = READ_THE_FILE.names or ()
    return len(message.fields) == len(names) and tuple(field.name for field in message.fields) == names


def map_message(table: PlaceTable, stamp_ns: int) -> PointCloud2:
    """What RViz and Foxglove draw: x, y, z in float32, intensity = U, place_id."""
    points = np.empty(len(table), VIEW)
    points['x'], points['y'], points['z'] = table.positions_m.T
    points['intensity'], points['place_id'] = table.uncertainties, table.place_ids
    return to_cloud(points, header(stamp_ns, MAP_FRAME))
