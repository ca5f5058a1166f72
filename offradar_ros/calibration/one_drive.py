"""Calibration over one ordinary drive: what the sensor shifts, and a threshold on U that few of its scans exceed."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.conformal import conformal_quantile, scans_for_quantile
from offradar_ros.calibration.encoded_drive import EncodedDrive
from offradar_ros.calibration.parameters import (
    Calibration,
    Thresholds,
    calibrated_parameters,
    shipped_confidence,
)
from offradar_ros.calibration.sensor_shift import shifted, typical_distance
from offradar_ros.calibration.variance_scale import spanning_delta, variance_factor
from offradar_ros.config import ConfidenceConfig, Config
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import LocalFrame
from offradar_ros.processes import Progress
from offradar_ros.recordings.road import PositionedDrive, positioned
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.retrieval.thresholds import static_thresholds
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import Embedding

FEWEST_SCANS = 2


def calibrate_drive(
    sequence: RadarSequence, config: Config, reject_at_most: float, progress: Progress | None = None
) -> Calibration:
    """Parameters for the encoder and the query; N is the configuration's.

    Coefficients of the probability that ship for the encoder are kept, and shifted as the sensor shifts them
    (`sensor_shift`): the usual U, and the scale of distances, which takes a kilometre of road with positions.

    The threshold on U is the lowest static one that rejects an ordinary scan with a chance of at most
    `reject_at_most`; 0 takes the highest, and so does a drive with too few scans. Scans that are refused are left out;
    DataError if fewer than two are left. The variance of a learned encoder is scaled by training (prior at 1).
    `progress` gets (done, scans) after each scan.
    """
    encoder, shipped = make_encoder(config.encoder), shipped_confidence(config)
    road = None if shipped is None else _positioned(sequence, config)
    kept = frozenset() if road is None else frozenset(road.rows.tolist())
    uncertainties, embeddings = _encoded(sequence, encoder, kept, progress)
    factor = variance_factor(uncertainties) if config.encoder.name == 'ring_key' else 1.0
    uncertainties = uncertainties * factor
    delta, levels = spanning_delta(uncertainties), config.query.levels
    thresholds = static_thresholds(delta, levels)
    needed = scans_for_quantile(reject_at_most) if reject_at_most > 0.0 else 0
    level = levels
    if 0 < needed <= len(uncertainties):
        level = int(np.searchsorted(thresholds, conformal_quantile(uncertainties, reject_at_most)))
    scans = len(uncertainties)
    rejected = int(np.sum(uncertainties > thresholds[level]))
    chance = reject_at_most if level < levels else 1.0 / (scans + 1)
    lines = [
        f'{scans} of {len(sequence)} scans: U {uncertainties.mean():.3f} on average, {uncertainties.min():.3f} to '
        f'{uncertainties.max():.3f}, standard deviation {uncertainties.std():.3f}; delta {delta:.3f}',
        f'level {level} of {levels} rejects U above {thresholds[level]:.3f}: {rejected} of these scans, and one more '
        f'like them with a chance of at most {chance:.4f}',
    ]
    if scans < needed:
        lines.append(
            f'note: {scans} scans are too few to reject {reject_at_most:g} of ordinary ones ({needed} are enough): the '
            'threshold is just above all of them, and will reject more'
        )
    lines.append('note: nothing is known of wrong answers: calibrate over several drives of one road to keep them rare')
    coefficients = None
    if shipped is not None:
        typical = None if road is None else _typical_distance(road, embeddings, config.query.tolerance_m)
        coefficients = shifted(shipped, float(np.median(uncertainties)), typical)
        lines.append(_shift(coefficients, typical))
    values = calibrated_parameters(config, encoder, factor, Thresholds(delta, levels, level), coefficients)
    return Calibration(values, f'{scans} scans of {sequence.name}', tuple(lines))


def _shift(coefficients: ConfidenceConfig, typical: float | None) -> str:
    usual = f'the shipped coefficients, with a usual U of {coefficients.usual_uncertainty:.3f}'
    if typical is None:
        return f'probability: {usual}; distances as shipped: their scale takes 1 km of road with positions'
    return (
        f'probability: {usual}, and distances in units of {typical:.3f}, which is typical of different places here '
        f'({coefficients.unrelated_distance:.3f} where the coefficients come from)'
    )


def _positioned(sequence: RadarSequence, config: Config) -> PositionedDrive | None:
    """The scans of a map of the drive; None where none has a position."""
    if sequence.trajectory is None or not len(sequence.trajectory):
        return None
    origin = sequence.trajectory.origin()
    frame = LocalFrame(origin) if origin else None
    try:
        drive = positioned(sequence, Path(sequence.name), frame, config.position.max_gap_s)
    except DataError:
        return None
    return drive.subsampled(MAP_SPACING_M)


def _encoded(
    sequence: RadarSequence, encoder: Encoder, kept: AbstractSet[int], progress: Progress | None
) -> tuple[NDArray[np.float64], dict[int, Embedding]]:
    """(M,) U of the scans that are not refused, and the embeddings of those in `kept`."""
    uncertainties: list[float] = []
    embeddings: dict[int, Embedding] = {}
    refused: dict[str, list[str]] = {}
    for index in range(len(sequence)):
        try:
            embedding = encoder.encode(sequence.scan(index))
        except RefusedInput as refusal:
            refused.setdefault(refusal.cause, []).append(str(refusal))
        else:
            uncertainties.append(embedding.uncertainty)
            if index in kept:
                embeddings[index] = embedding
        if progress is not None:
            progress(index + 1, len(sequence))
    if len(uncertainties) < FEWEST_SCANS:
        causes = [
            f'{len(messages)} of {len(sequence)} scans refused: {cause}: {messages[0]}'
            for cause, messages in refused.items()
        ]
        raise DataError(
            f'{sequence.name}: expected at least {FEWEST_SCANS} scans that can be encoded, got {len(uncertainties)}'
            + ''.join(f'; {cause}' for cause in causes)
        )
    return np.array(uncertainties, np.float64), embeddings


def _typical_distance(road: PositionedDrive, embeddings: Mapping[int, Embedding], tolerance_m: float) -> float | None:
    """`typical_distance` of the scans with an embedding."""
    road = road.only(np.isin(road.rows, list(embeddings)))
    if not len(road):
        return None
    found = [embeddings[row] for row in road.rows.tolist()]
    means = np.stack([embedding.mean for embedding in found])
    uncertainties = np.array([embedding.uncertainty for embedding in found])
    drive = EncodedDrive(road.name, road.stamps_ns, road.poses, road.driven_m, means, uncertainties)
    return typical_distance(drive, tolerance_m)
