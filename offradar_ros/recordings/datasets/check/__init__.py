"""Check of a data-set folder: what it holds, and every problem that is found."""

from offradar_ros.recordings.datasets.check.findings import Finding, Findings, Level
from offradar_ros.recordings.datasets.check.folder import check_folder

__all__ = ['Finding', 'Findings', 'Level', 'check_folder']
