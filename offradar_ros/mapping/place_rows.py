"""Places as rows of a map file, and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from offradar_ros.types import PlaceTable

CONTENT_COLUMNS = 'place_id, session_id, stamp_ns, x_m, y_m, z_m, yaw_rad, uncertainty, mean'
"""Columns of `places` and `undo`, in the order in which they are read and written."""


def rows_to_table(rows: Sequence[Sequence[Any]], dimension: int) -> PlaceTable:
    """Rows that begin with `CONTENT_COLUMNS`, as a table of places; ValueError for an invalid value."""
    columns = list(zip(*rows, strict=True)) if rows else [()] * 9
    ids, sessions, stamps, x_m, y_m, z_m, yaws, uncertainties, means = columns[:9]
    table = PlaceTable(
        place_ids=np.array(ids, np.int64),
        session_ids=np.array(sessions, np.int32),
        stamps_ns=np.array(stamps, np.int64),
        positions_m=np.array([x_m, y_m, z_m], np.float64).T,
        yaws_rad=np.array(yaws, np.float64),
        uncertainties=np.array(uncertainties, np.float32),
        means=np.frombuffer(b''.join(means), '<f4').reshape(len(ids), dimension),
    )
    if not all(np.isfinite(values).all() for values in (table.positions_m, table.uncertainties, table.means)):
        raise ValueError('a place holds a value that is not finite')
    return table


def table_to_rows(table: PlaceTable) -> Iterator[tuple[Any, ...]]:
    """The inverse of `rows_to_table`. SQLite stores the NaN of an unknown yaw as NULL."""
    columns = (table.place_ids, table.session_ids, table.stamps_ns, *table.positions_m.T)
    columns = (*columns, table.yaws_rad, table.uncertainties)
    means = (mean.astype('<f4', copy=False).tobytes() for mean in table.means)
    return zip(*(column.tolist() for column in columns), means, strict=True)
