"""What several drives of one road tell: how uncertain answers may be before too many of them are wrong."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import Config
from offradar_ros.encoders.calibration import spanning_delta, variance_factor
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.cli.calibrated_drive import Calibrated
from offradar_ros.lab.evaluation.calibration.calibrated_parameters import calibrated_parameters
from offradar_ros.lab.evaluation.calibration.error_control import upper_bound
from offradar_ros.lab.evaluation.calibration.reliability import draw_reliability
from offradar_ros.lab.evaluation.calibration.threshold_choice import ThresholdChoice, choose_threshold
from offradar_ros.lab.evaluation.calibration.validation_queries import SQUARE_M, validation_queries
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive, encode
from offradar_ros.lab.evaluation.nearness import nearest_m
from offradar_ros.lab.evaluation.protocol import Group, Protocol, Recorded
from offradar_ros.lab.evaluation.recorded_drives import RecordedSource, recorded_drives
from offradar_ros.recordings.source import require_recording
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.recordings.truth import TOLERANCE_M
from offradar_ros.retrieval.thresholds import static_thresholds

FEW_SQUARES = 60
"""Fewer tell little: even without a wrong answer they allow for 5 %."""


class Wanted(NamedTuple):
    """At most `error_rate` wrong answers with `confidence`, told by a scan every `spacing_m`."""

    error_rate: float
    confidence: float
    spacing_m: float


def calibrated_road(
    paths: Sequence[Path], layout: str, config: Config, wanted: Wanted
) -> tuple[Calibrated, ThresholdChoice]:
    """Parameters for the encoder and the query; N is the configuration's.

    DataError for drives without positions or of different roads, and where no threshold keeps the rate that is wanted.
    """
    encoder = make_encoder(config.encoder)
    drives, lacking = _encoded(paths, layout, config, encoder, wanted.spacing_m)
    queries = validation_queries(drives, MAP_SPACING_M, TOLERANCE_M)
    known = np.isfinite(queries.uncertainties)
    factor = variance_factor(queries.uncertainties[known]) if config.encoder.name == 'ring_key' else 1.0
    queries = dataclasses.replace(queries, uncertainties=queries.uncertainties * factor)
    delta, levels = spanning_delta(queries.uncertainties[known]), config.query.levels
    choice = choose_threshold(queries, static_thresholds(delta, levels), wanted.error_rate, wanted.confidence)
    values = calibrated_parameters(config, encoder, factor, delta, levels, choice.level)
    source = f'{len(queries)} scans of {", ".join(drive.drive.name for drive in drives)}'
    return Calibrated(values, source, [*_lines(choice, delta), *(f'note: {text}' for text in lacking)]), choice


def draw(choice: ThresholdChoice, path: Path) -> None:
    """The reliability plot; ConfigError where it cannot be written."""
    try:
        draw_reliability(choice, path)
    except (OSError, ValueError) as error:
        raise ConfigError(f'{path}: the plot cannot be written ({error})') from error


def _encoded(
    paths: Sequence[Path], layout: str, config: Config, encoder: Encoder, spacing_m: float
) -> tuple[list[EmbeddedDrive], list[str]]:
    for path in paths:
        require_recording(path, layout)
    road = Recorded('calibration', sequences=tuple(str(path.resolve()) for path in paths))
    group = Group('calibration', 'Validation drives', recorded=(road,))
    protocol = Protocol('calibration', 'Validation drives', (group,), drive_spacing_m=spacing_m)
    opened = recorded_drives(protocol, RecordedSource(None, config.radar, config.position, layout))
    for drive in opened.drives:
        away_m = min(nearest_m(drive, other) for other in opened.drives if other is not drive)
        if away_m > TOLERANCE_M:
            raise DataError(
                f'{drive.name}: no scan within {TOLERANCE_M:g} m of another drive, the nearest {away_m:.0f} m away: '
                'expected drives of one road'
            )
    made = []
    for drive in opened.drives:
        with progress_bar(f'encoding {drive.name}') as progress:
            made.append(encode(encoder, drive, progress))
    return made, opened.lacking


def _lines(choice: ThresholdChoice, delta: float) -> list[str]:
    queries, sure = choice.queries, f'{choice.confidence:g}'
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
        f'at most {rate:g} of the answers are wrong, with confidence {sure} (of this level alone: {bound:.4f})',
        f'one more scan is answered wrongly with a chance of at most {rate:g} (conformal: ({wrong} + 1)/({scans} + 1) '
        f'= {choice.chance_of_wrong_answer:.4f} is not above it)',
        f'expected to be rejected: {share:.4f} of the scans ({low:.4f} to {high:.4f}, confidence {sure}); here '
        f'{scans - right - wrong} of {scans - right} wrong answers and {right - choice.answered + wrong} of {right} '
        'right ones',
        f'counted by squares of {SQUARE_M:g} m of ground, {choice.squares} of them, not by scans, no more is certain '
        f'than {choice.error_rate_by_squares:.4f}{few}',
        'note: this holds for scans drawn as these were; those of one drive are alike: calibrate over several drives, '
        'of all weathers that the vehicle meets',
    ]
