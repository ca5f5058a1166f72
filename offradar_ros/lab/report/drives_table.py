"""The drives of an evaluation."""

from __future__ import annotations

from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source


def drives_table(source: Source) -> TableSection:
    """Every drive, with its number of scans, path length and role."""
    return TableSection(
        'drives',
        'Drives',
        'A scan is a query once for each map in which it is searched for. Scans that are left out, for their spacing, '
        'their region or a missing position, are not counted here.',
        ('drive', 'road', 'scans', 'path length (m)', 'role'),
        tuple(
            (drive.name, drive.world, str(drive.scans), f'{drive.path_length_m:.0f}', drive.roles)
            for drive in source.results.drives
        ),
    )
