"""Calibration over several drives of one road: the probability that an answer is right, and a gate that keeps
promises about it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offradar_ros.calibration.conformal import conformal_quantile
from offradar_ros.calibration.cross_fit import cross_fit
from offradar_ros.calibration.encoded_drive import EncodedDrive, encoded_drives
from offradar_ros.calibration.error_control import ErrorLimit
from offradar_ros.calibration.gate_choice import GateChoice, choose_gate
from offradar_ros.calibration.left_out_queries import LeftOutQueries, left_out_queries
from offradar_ros.calibration.parameters import (
    MIN_PROBABILITY,
    MIN_PROBABILITY_UNALIGNED,
    Calibration,
    Thresholds,
    calibrated_parameters,
    shipped_confidence,
)
from offradar_ros.calibration.road_alignments import RoadAlignments
from offradar_ros.calibration.road_report import gate_lines, threshold_lines
from offradar_ros.calibration.threshold_choice import ThresholdChoice, choose_threshold
from offradar_ros.calibration.validation_queries import validation_queries
from offradar_ros.calibration.variance_scale import spanning_delta, variance_factor
from offradar_ros.config import ConfidenceConfig, Config
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError
from offradar_ros.processes import Progress
from offradar_ros.recordings.road import PositionedDrive
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.retrieval.thresholds import static_thresholds

UNCERTAIN_AT_MOST = 0.01
"""Share of the right answers that may be called uncertain, where the probability is the gate."""


class _Encoded(NamedTuple):
    """Drives with U as the result scales it, the factor on the variance, and the usual and largest |U − 1|."""

    drives: list[EncodedDrive]
    encoder: Encoder
    factor: float
    usual: float
    delta: float


def calibrate_road(
    drives: Sequence[PositionedDrive], config: Config, limit: ErrorLimit, progress: Progress | None = None
) -> tuple[Calibration, GateChoice | ThresholdChoice]:
    """Parameters for the encoder and the query, from two drives or more in one frame; N is the configuration's.

    With `query.gate: probability`, the coefficients are learned from left-out halves of the maps, and the gate keeps
    both promises of `limit`. With `query.verify` and `encoder.signature`, both are about answers with alignments. With
    `query.gate: paper`, the threshold on U keeps the error rate, and the shipped coefficients are kept.

    DataError for drives of different roads, and where nothing keeps the promises. `progress` gets (done, total), where
    each scan of each drive counts once, and twice more if it is aligned.
    """
    tolerance_m = config.query.tolerance_m
    for drive in drives:
        away_m = min(_nearest_m(drive, other) for other in drives if other is not drive)
        if away_m > tolerance_m:
            raise DataError(
                f'{drive.name}: no scan within {tolerance_m:g} m of another drive, the nearest {away_m:.0f} m away: '
                'expected drives of one road'
            )
    scans = sum(len(drive) for drive in drives)
    report: Progress = progress or (lambda _, __: None)
    if config.query.gate == 'paper':
        return _by_threshold(_encoded(drives, config, report), config, limit)
    if not (config.query.verify and config.encoder.signature):
        return _by_probability(_encoded(drives, config, report), config, limit)
    encoded = _encoded(drives, config, lambda done, _: report(done, 3 * scans))
    alignments = RoadAlignments(
        encoded.drives,
        [drive.sequence for drive in drives],
        [drive.rows for drive in drives],
        config.query.verify_candidates,
        lambda done: report(scans + done, 3 * scans),
    )
    found = _by_probability(encoded, config, limit, alignments)
    report(3 * scans, 3 * scans)
    return found


def _encoded(drives: Sequence[PositionedDrive], config: Config, progress: Progress) -> _Encoded:
    encoder = make_encoder(config.encoder)
    encoded = encoded_drives(drives, encoder, progress)
    usable = np.concatenate([drive.uncertainties[drive.usable] for drive in encoded])
    factor = variance_factor(usable) if config.encoder.name == 'ring_key' else 1.0
    scaled = [dataclasses.replace(drive, uncertainties=drive.uncertainties * factor) for drive in encoded]
    return _Encoded(scaled, encoder, factor, float(np.median(usable * factor)), spanning_delta(usable * factor))


def _by_probability(
    encoded: _Encoded, config: Config, limit: ErrorLimit, alignments: RoadAlignments | None = None
) -> tuple[Calibration, GateChoice]:
    """The threshold on U refuses nothing here. It is the lowest that few right answers exceed, and names the others."""
    prior = shipped_confidence(config, encoded.usual)
    queries = left_out_queries(encoded.drives, MAP_SPACING_M, config.query.tolerance_m, alignments)
    choice = choose_gate(cross_fit(queries, prior), limit)
    thresholds = static_thresholds(encoded.delta, config.query.levels)
    right = queries.evidence.uncertainty[choice.fit.right]
    level = int(np.searchsorted(thresholds, conformal_quantile(right, UNCERTAIN_AT_MOST)))
    values = calibrated_parameters(
        config,
        encoded.encoder,
        encoded.factor,
        Thresholds(encoded.delta, config.query.levels, level),
        choice.fit.coefficients,
    )
    values[MIN_PROBABILITY] = choice.min_probability
    values[MIN_PROBABILITY_UNALIGNED] = unaligned = _unaligned_gate(queries, prior, limit)
    lines = gate_lines(choice, unaligned, prior, float(thresholds[level]), str(values['query.model']))
    return Calibration(values, _source(encoded), tuple(lines)), choice


def _unaligned_gate(queries: LeftOutQueries, prior: ConfidenceConfig | None, limit: ErrorLimit) -> float:
    """The gate that keeps both promises for scans without an alignment, as before signatures have come; 1 for none.

    0 without alignments: the other gate is for such answers then.
    """
    if queries.aligned is None:
        return 0.0
    try:
        return choose_gate(cross_fit(dataclasses.replace(queries, aligned=None), prior), limit).min_probability
    except DataError:
        return 1.0


def _by_threshold(encoded: _Encoded, config: Config, limit: ErrorLimit) -> tuple[Calibration, ThresholdChoice]:
    queries = validation_queries(encoded.drives, MAP_SPACING_M, config.query.tolerance_m)
    thresholds = static_thresholds(encoded.delta, config.query.levels)
    choice = choose_threshold(queries, thresholds, limit.error_rate, limit.confidence)
    values = calibrated_parameters(
        config,
        encoded.encoder,
        encoded.factor,
        Thresholds(encoded.delta, config.query.levels, choice.level),
        shipped_confidence(config, encoded.usual),
    )
    return Calibration(values, _source(encoded), tuple(threshold_lines(choice, encoded.delta))), choice


def _source(encoded: _Encoded) -> str:
    scans = sum(len(drive) for drive in encoded.drives)
    return f'{scans} scans of {", ".join(drive.name for drive in encoded.drives)}'


def _nearest_m(drive: PositionedDrive, other: PositionedDrive) -> float:
    """Metres between the two scans of two drives that are nearest to each other."""
    return min(float(np.hypot(*(other.poses[:, :2] - here).T).min()) for here in drive.poses[:, :2])
