"""The file of results."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.lab.evaluation.results.results import Results
from offradar_ros.lab.evaluation.stored_record import StoredFormat

RESULTS_FILE = 'results.json'
"""File name in the folder of an evaluation."""

FORMAT = StoredFormat(
    Results,
    kind='offradar-evaluation',
    number=4,
    description=f'the {RESULTS_FILE} of offradar evaluate',
    remedy='run offradar evaluate again, with the same --cache',
)


def write_results(path: str | Path, results: Results) -> None:
    """Write JSON, with null for NaN and infinity; ModelError if it cannot be written."""
    FORMAT.write(path, results)


def read_results(path: str | Path) -> Results:
    """The results in a file of `write_results`, with NaN for null; DataError for another file or format."""
    return FORMAT.read(path)
