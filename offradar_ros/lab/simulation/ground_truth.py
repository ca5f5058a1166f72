"""Ground truth of each simulated scan, as a CSV table."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.whole_file import write_whole_file

COLUMNS = ('stamp_ns', 'x_m', 'y_m', 'heading_rad', 'kind', 'severity', 'azimuth')


def write_ground_truth(sequence: SimulatedSequence, path: str | Path) -> None:
    """Write a CSV file with a header and one row per scan, in the frame of the world.

    `kind` is empty and `severity` 0 for a clean scan; `azimuth` is the row where the fault starts. DataError if the
    file cannot be written.
    """
    table = io.StringIO(newline='')
    writer = csv.writer(table)
    writer.writerow(COLUMNS)
    rows = zip(sequence.stamps_ns.tolist(), sequence.poses.tolist(), sequence.degradations, strict=True)
    for stamp_ns, (x, y, heading), fault in rows:
        columns = (fault.kind.value, f'{fault.severity:.4f}', fault.azimuth) if fault else ('', 0, '')
        writer.writerow((stamp_ns, f'{x:.3f}', f'{y:.3f}', f'{heading:.5f}', *columns))
    try:
        write_whole_file(path, table.getvalue().encode())
    except OSError as error:
        raise DataError(f'{path}: cannot be written ({error.strerror})') from error
