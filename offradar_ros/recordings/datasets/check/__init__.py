"""What a data-set folder holds, and everything wrong with it, in plain words."""

from offradar_ros.recordings.datasets.check.findings import Finding, Findings, Level
from offradar_ros.recordings.datasets.check.folder import check_folder

__all__ = ['Finding', 'Findings', 'Level', 'check_folder']
