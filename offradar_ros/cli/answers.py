"""Answers of a drive as a CSV file with a row for each scan, and their Recall@1."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Optional

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.recordings.drive import DriveResult
from offradar_ros.recordings.truth import TOLERANCE_M, recall_at_1
from offradar_ros.types import Localisation, Match, Outcome
from offradar_ros.whole_file import write_whole_file

COLUMNS = (
    'stamp_ns',
    'answer',
    'reason',
    'p_right',
    'uncertainty',
    'threshold',
    'place_id',
    'distance',
    'distance_apart',
    'place_distance_apart',
    'place_uncertainty',
    'x_m',
    'y_m',
)
LOCALISATION_COLUMNS = ('state', 'p_on_map', 'p_here', 'localised_x_m', 'localised_y_m')
TRUTH_COLUMNS = ('true_x_m', 'true_y_m', 'error_m')


def write_answers(path: Path, result: DriveResult, positions: NDArray[np.float64], errors: NDArray[np.float64]) -> None:
    """CSV with the best candidate, returned or withheld, of each outcome, and where the vehicle then is.

    Unknown values are empty.

    `positions` (N, 2) and `errors` (N,) as `offradar_ros.recordings.truth` has them, metres in the ``map`` frame.
    """
    table = io.StringIO(newline='')
    writer = csv.writer(table, lineterminator='\n')
    writer.writerow((*COLUMNS, *LOCALISATION_COLUMNS, *TRUTH_COLUMNS))
    truth = np.column_stack([positions, errors]).tolist()
    for outcome, found, true in zip(result.outcomes, result.localisations, truth, strict=True):
        writer.writerow((*_answer(outcome), *_localisation(found), *map(_known, true)))
    try:
        write_whole_file(path, table.getvalue().encode())
    except OSError as error:
        raise DataError(f'{path}: cannot be written ({error.strerror})') from error


def _answer(outcome: Outcome) -> list[object]:
    is_match = isinstance(outcome, Match)
    row = [
        outcome.stamp_ns,
        'match' if is_match else 'rejected',
        '' if isinstance(outcome, Match) else outcome.reason.value,
        _known(outcome.p_right),
        _known(outcome.uncertainty),
        outcome.threshold,
    ]
    if not outcome.candidates:
        return [*row, *('' for _ in range(7))]
    best, evidence = outcome.candidates[0], outcome.evidence
    apart = (evidence.distance_apart, evidence.place_distance_apart) if evidence else (math.nan, math.nan)
    return [*row, best.place_id, best.distance, *map(_known, apart), best.uncertainty, best.pose.x_m, best.pose.y_m]


def _localisation(found: Optional[Localisation]) -> list[object]:
    if found is None:
        return ['' for _ in LOCALISATION_COLUMNS]
    return [found.state.value, found.p_on_map, found.p_here, *map(_known, found.position_m.tolist())]


def _known(value: float) -> object:
    return value if math.isfinite(value) else ''


def recall_line(outcomes: Sequence[Outcome], errors: NDArray[np.float64], mapped: NDArray[np.bool_]) -> str:
    """Recall@1 of the scans on the map, and of the matches among them; how many scans off the map are answered.

    `errors` (N,) is that of `offradar_ros.recordings.truth`, and `mapped` (N,) whether the map has a place within the
    tolerance. Scans of unknown position are left out; empty without a finite error.
    """
    known = ~np.isnan(errors)
    if not np.isfinite(errors).any():
        return ''
    matched = np.array([isinstance(outcome, Match) for outcome in outcomes], np.bool_) & known
    here, away = known & mapped, known & ~mapped
    text = f'Recall@1 within {TOLERANCE_M:g} m: -, no scan is on the map'
    if here.any():
        on_it = ' on the map' if away.any() else ''
        text = f'Recall@1 within {TOLERANCE_M:g} m: {recall_at_1(errors[here]):.3f} of {int(here.sum())} scans{on_it}'
    if (matched & here).any():
        text += f', {recall_at_1(errors[matched & here]):.3f} of {int((matched & here).sum())} matches{on_it}'
    if away.any():
        text += f'; off the map, {int((matched & away).sum())} of {int(away.sum())} scans are answered'
    unknown = int((~known).sum())
    return text + (f' ({unknown} without a recorded position left out)' if unknown else '')
