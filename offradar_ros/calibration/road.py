"""Calibration over several drives of one road: a threshold that keeps wrong answers rare."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offradar_ros.calibration.error_control import upper_bound
from offradar_ros.calibration.parameters import Calibration, Thresholds, calibrated_parameters
from offradar_ros.calibration.threshold_choice import ThresholdChoice, choose_threshold
from offradar_ros.calibration.validation_queries import SQUARE_M, EncodedDrive, validation_queries
from offradar_ros.calibration.variance_scale import spanning_delta, variance_factor
from offradar_ros.config import Config
from offradar_ros.encoders.encode import encode_all
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError
from offradar_ros.processes import Progress
from offradar_ros.recordings.road import PositionedDrive
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.recordings.truth import TOLERANCE_M
from offradar_ros.retrieval.thresholds import static_thresholds

FEW_SQUARES = 60
"""With fewer squares of ground the bound is weak: above 5 % even without a wrong answer."""


class ErrorLimit(NamedTuple):
    """At most the share `error_rate` of the answers wrong, with `confidence`."""

    error_rate: float
    confidence: float


def calibrate_road(
    drives: Sequence[PositionedDrive], config: Config, limit: ErrorLimit, progress: Progress | None = None
) -> tuple[Calibration, ThresholdChoice]:
    """Parameters for the encoder and the query, from two drives or more in one frame; N is the configuration's.

    DataError for drives of different roads, and where no threshold keeps the error rate. `progress` gets (done, scans)
    over the scans of all drives.
    """
    for drive in drives:
        away_m = min(_nearest_m(drive, other) for other in drives if other is not drive)
        if away_m > TOLERANCE_M:
            raise DataError(
                f'{drive.name}: no scan within {TOLERANCE_M:g} m of another drive, the nearest {away_m:.0f} m away: '
                'expected drives of one road'
            )
    encoder = make_encoder(config.encoder)
    queries = validation_queries(_encoded(drives, encoder, progress), MAP_SPACING_M, TOLERANCE_M)
    known = np.isfinite(queries.uncertainties)
    factor = variance_factor(queries.uncertainties[known]) if config.encoder.name == 'ring_key' else 1.0
    queries = dataclasses.replace(queries, uncertainties=queries.uncertainties * factor)
    delta, levels = spanning_delta(queries.uncertainties[known]), config.query.levels
    choice = choose_threshold(queries, static_thresholds(delta, levels), limit.error_rate, limit.confidence)
    usable = queries.uncertainties[known]
    values = calibrated_parameters(config, encoder, usable, factor, Thresholds(delta, levels, choice.level))
    source = f'{len(queries)} scans of {", ".join(drive.name for drive in drives)}'
    return Calibration(values, source, tuple(_lines(choice, delta))), choice


def _nearest_m(drive: PositionedDrive, other: PositionedDrive) -> float:
    """Metres between the two scans of two drives that are nearest to each other."""
    return min(float(np.hypot(*(other.poses[:, :2] - here).T).min()) for here in drive.poses[:, :2])


def _encoded(drives: Sequence[PositionedDrive], encoder: Encoder, progress: Progress | None) -> list[EncodedDrive]:
    total, done, encoded = sum(len(drive) for drive in drives), 0, []
    for drive in drives:

        def advance(done_of_drive: int, _: int, before: int = done) -> None:
            if progress is not None:
                progress(before + done_of_drive, total)

        means, variances = encode_all(encoder, drive, advance)
        uncertainties = variances.mean(axis=1, dtype=np.float64)
        uncertainties[~(np.isfinite(means).all(axis=1) & np.isfinite(uncertainties))] = np.inf
        encoded.append(EncodedDrive(drive.name, drive.stamps_ns, drive.poses, drive.driven_m, means, uncertainties))
        done += len(drive)
    return encoded


def _lines(choice: ThresholdChoice, delta: float) -> list[str]:
    queries, confidence = choice.queries, f'{choice.confidence:g}'
    scans, right = len(queries), int(np.sum(~queries.wrong))
    known = queries.uncertainties[np.isfinite(queries.uncertainties)]
    share, low, high = choice.rejection
    wrong, rate, bound = choice.wrong, choice.error_rate, upper_bound(choice.wrong, choice.answered, choice.confidence)
    few = ': too few squares to say more' if choice.squares < FEW_SQUARES else ''
    return [
        f'{scans} scans of {queries.drives} drives, {queries.refused} refused: {right} find their place in the map of '
        f'another drive, {scans - right} do not, {int(np.sum(~queries.positive))} of which have none there',
        f'U {known.mean():.3f} on average, {known.min():.3f} to {known.max():.3f}; delta {delta:.3f}',
        f'level {choice.level} of {len(choice.thresholds) - 1} rejects U above {choice.threshold:.3f}: '
        f'{wrong} of {choice.answered} answers are wrong ({wrong / choice.answered:.4f})',
        *(['note: it rejects none of these scans: so few answers are wrong without it'] * (choice.answered == scans)),
        f'at most {rate:g} of the answers are wrong, with confidence {confidence} (of this level alone: {bound:.4f})',
        f'one more scan is answered wrongly with a chance of at most {rate:g} (conformal: ({wrong} + 1)/({scans} + 1) '
        f'= {choice.chance_of_wrong_answer:.4f} is not above it)',
        f'expected to be rejected: {share:.4f} of the scans ({low:.4f} to {high:.4f}, confidence {confidence}); here '
        f'{scans - right - wrong} of {scans - right} wrong answers and {right - choice.answered + wrong} of {right} '
        'right ones',
        f'counted by squares of {SQUARE_M:g} m of ground, {choice.squares} of them, not by scans, no more is certain '
        f'than {choice.error_rate_by_squares:.4f}{few}',
        'note: this holds for scans drawn as these were; those of one drive are alike: calibrate over several drives, '
        'of all weathers that the vehicle meets',
    ]
