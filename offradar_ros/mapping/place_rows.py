"""Places as rows of a map file, and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.mapping.seal import digests
from offradar_ros.types import PlaceTable

CONTENT_COLUMNS = 'place_id, session_id, stamp_ns, x_m, y_m, z_m, yaw_rad, yaw_sd_rad, uncertainty, mean'
"""Columns of `places` and `undo`, in the order in which they are read and written."""
CONTENTS = len(CONTENT_COLUMNS.split(', '))

_TYPES: tuple[Any, ...] = (
    *({int},) * 3,
    *({float},) * 3,
    *({float, type(None)},) * 2,
    {float},
    {bytes},
)


def content_columns(version: int) -> str:
    """What is selected from a map of this version as `CONTENT_COLUMNS`."""
    return CONTENT_COLUMNS if version >= 4 else CONTENT_COLUMNS.replace('yaw_sd_rad', 'NULL')


def rows_to_table(rows: Sequence[Sequence[Any]], dimension: int) -> PlaceTable:
    """Rows that begin with `CONTENT_COLUMNS`, as a table of places; ValueError for an invalid value."""
    columns = list(zip(*rows, strict=True))[:CONTENTS] if rows else [()] * CONTENTS
    for name, column, types in zip(CONTENT_COLUMNS.split(', '), columns, _TYPES, strict=True):
        if not types.issuperset(map(type, column)):
            raise ValueError(f'a place holds a {name} of another type')
    ids, sessions, stamps, x_m, y_m, z_m, yaws, yaw_sds, uncertainties, means = columns
    if set(map(len, means)) - {4 * dimension}:
        raise ValueError(f'a place holds a mean that is not of dimension {dimension}')
    # What is too large for a float32 becomes infinite, which no place may be.
    with np.errstate(over='ignore'):
        return PlaceTable(
            place_ids=np.array(ids, np.int64),
            session_ids=_narrowed(np.array(sessions, np.int64)),
            stamps_ns=np.array(stamps, np.int64),
            positions_m=np.array([x_m, y_m, z_m], np.float64).T,
            yaws_rad=np.array(yaws, np.float64),
            yaw_sds_rad=np.array(yaw_sds, np.float32),
            uncertainties=np.array(uncertainties, np.float32),
            means=np.frombuffer(b''.join(means), '<f4').reshape(len(ids), dimension),
        )


def _narrowed(session_ids: NDArray[np.int64]) -> NDArray[np.int32]:
    if ((session_ids < 0) | (session_ids > np.iinfo(np.int32).max)).any():
        raise ValueError('a place holds a session_id out of range')
    return session_ids.astype(np.int32)


def table_to_rows(table: PlaceTable) -> Iterator[tuple[Any, ...]]:
    """The inverse of `rows_to_table`. SQLite stores the NaN of an unknown heading as NULL."""
    columns = (table.place_ids, table.session_ids, table.stamps_ns, *table.positions_m.T)
    columns = (*columns, table.yaws_rad, table.yaw_sds_rad, table.uncertainties)
    means = (mean.astype('<f4', copy=False).tobytes() for mean in table.means)
    return zip(*(column.tolist() for column in columns), means, strict=True)


def place_digests(table: PlaceTable, anchors_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) digests of rows of `places`; `anchors_m` (N, 2)."""
    return digests('places', _packed(table, anchors_m))


def undo_digests(table: PlaceTable, by_sessions: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) digests of rows of `undo` that hold earlier content of places, by the (N,) sessions that changed it."""
    return digests('undo', _packed(table, by_sessions[:, None]))


def inserted_digests(place_ids: NDArray[np.int64], by_sessions: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) digests of rows of `undo` of places that did not exist before a session."""
    rows = np.stack([place_ids, by_sessions], axis=1).astype('<i8')
    return digests('undo', (row.tobytes() for row in rows))


def _packed(table: PlaceTable, beside: NDArray[Any]) -> Iterator[memoryview]:
    """The bytes of each row, and of its row in `beside`.

    The standard deviation of its heading follows where it is known, so that rows of versions without it have the same
    digests in any version.
    """
    count = len(table)
    fields: tuple[tuple[str, NDArray[Any]], ...] = (
        ('ids', np.stack([table.place_ids, table.session_ids, table.stamps_ns], axis=1).astype('<i8')),
        # SQLite does not keep the sign of a zero.
        ('pose', np.column_stack([table.positions_m, _one_nan(table.yaws_rad)]).astype('<f8') + 0.0),
        ('uncertainty', table.uncertainties.astype('<f4').reshape(count, 1) + np.float32(0.0)),
        ('beside', beside if beside.dtype.kind == 'i' else beside + 0.0),
        ('mean', table.means.astype('<f4', copy=False)),
    )
    rows = np.empty(count, [(name, values.dtype, values.shape[1:]) for name, values in fields])
    for name, values in fields:
        rows[name] = values
    whole, size = memoryview(rows.tobytes()), rows.dtype.itemsize
    rest = table.yaw_sds_rad.astype('<f4', copy=False)
    for row, is_known in enumerate((~np.isnan(rest)).tolist()):
        bytes_of_row = whole[row * size : (row + 1) * size]
        yield memoryview(bytes(bytes_of_row) + rest[row].tobytes()) if is_known else bytes_of_row


def _one_nan(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isnan(values), np.nan, values)
