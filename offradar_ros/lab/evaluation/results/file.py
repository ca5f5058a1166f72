"""The results' file."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.lab.evaluation.results.results import Results
from offradar_ros.lab.evaluation.stored_record import StoredFormat

RESULTS_FILE = 'results.json'
"""Its name in the folder of an evaluation."""

FORMAT = StoredFormat(
    Results,
    kind='offradar-evaluation',
    number=3,
    description=f'the {RESULTS_FILE} of offradar evaluate',
    remedy='run offradar evaluate again, with the same --cache',
)


def write_results(path: str | Path, results: Results) -> None:
    """Write JSON, with null for what is not finite; ModelError where it cannot be written."""
    FORMAT.write(path, results)


def read_results(path: str | Path) -> Results:
    """What `write_results` wrote, with NaN for null; DataError for anything else, and for another format."""
    return FORMAT.read(path)
