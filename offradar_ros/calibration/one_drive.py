"""Calibration over one ordinary drive: the scale of U, and a threshold that few of its scans exceed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.conformal import conformal_quantile, scans_for_quantile
from offradar_ros.calibration.parameters import (
    Calibration,
    Thresholds,
    calibrated_parameters,
    shipped_confidence,
)
from offradar_ros.calibration.variance_scale import spanning_delta, variance_factor
from offradar_ros.config import Config
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.processes import Progress
from offradar_ros.radar.repeated_power import RepeatedPower
from offradar_ros.retrieval.thresholds import static_thresholds
from offradar_ros.sequence import RadarSequence

FEWEST_SCANS = 2


def calibrate_drive(
    sequence: RadarSequence, config: Config, reject_at_most: float, progress: Progress | None = None
) -> Calibration:
    """Parameters for the encoder and the query; N is the configuration's.

    Coefficients of the probability that ship for the encoder are kept, with the median U of the drive as the usual
    one. The threshold on U is the lowest static one that rejects an ordinary scan with a chance of at most
    `reject_at_most`; 0 takes the highest, and so does a drive with too few scans. Scans that are refused, or repeat the
    one before, are left out; DataError if fewer than two are left. The variance of a learned encoder is scaled by
    training (prior at 1): only its threshold is chosen. `progress` gets (done, scans) after each scan.
    """
    encoder = make_encoder(config.encoder)
    uncertainties = _uncertainties(sequence, encoder, progress)
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
    coefficients = shipped_confidence(config, float(np.median(uncertainties)))
    if coefficients is not None:
        usual = coefficients.usual_uncertainty
        lines.append(f'probability: the shipped coefficients are kept, with a usual U of {usual:.3f}')
    values = calibrated_parameters(config, encoder, factor, Thresholds(delta, levels, level), coefficients)
    return Calibration(values, f'{scans} scans of {sequence.name}', tuple(lines))


def _uncertainties(sequence: RadarSequence, encoder: Encoder, progress: Progress | None) -> NDArray[np.float64]:
    """(M,) U of the scans that are not refused."""
    found: list[float] = []
    refused: dict[str, list[str]] = {}
    power = RepeatedPower()
    for index in range(len(sequence)):
        try:
            scan = sequence.scan(index)
            uncertainty = encoder.encode(scan).uncertainty
            if power.is_repeated(scan):
                raise RefusedInput('repeated_power', f'scan at {scan.stamp_ns} ns is the one before once more')
            found.append(uncertainty)
        except RefusedInput as refusal:
            refused.setdefault(refusal.cause, []).append(str(refusal))
        if progress is not None:
            progress(index + 1, len(sequence))
    if len(found) < FEWEST_SCANS:
        causes = [
            f'{len(messages)} of {len(sequence)} scans refused: {cause}: {messages[0]}'
            for cause, messages in refused.items()
        ]
        raise DataError(
            f'{sequence.name}: expected at least {FEWEST_SCANS} scans that can be encoded, got {len(found)}'
            + ''.join(f'; {cause}' for cause in causes)
        )
    return np.array(found, np.float64)
