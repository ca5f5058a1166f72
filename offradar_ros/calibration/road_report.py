"""What a calibration over several drives says, line by line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.error_control import interval, upper_bound
from offradar_ros.calibration.gate_choice import GateChoice, confidence_of_each
from offradar_ros.calibration.probability_scores import brier_score, expected_calibration_error
from offradar_ros.calibration.stretches import SQUARE_M
from offradar_ros.calibration.threshold_choice import ThresholdChoice
from offradar_ros.config import ConfidenceConfig
from offradar_ros.retrieval.confidence import logistic

FEW_SQUARES = 60
"""With fewer squares of ground the bound is weak: above 5 % even without a wrong answer."""

ALIKE = (
    'note: this holds for scans drawn as these were; those of one drive are alike: calibrate over several drives, of '
    'all weathers that the vehicle meets'
)


_UNALIGNED = {
    True: 'it keeps the same for answers without an alignment, as where the map has no signatures',
    False: 'no gate keeps the same for answers without an alignment, so hardly any is given',
}


def gate_lines(
    choice: GateChoice, unaligned: float, prior: ConfidenceConfig | None, threshold: float, fingerprint: str
) -> list[str]:
    """What the gate on the probability keeps; `prior` are the coefficients that were known before.

    `unaligned` is the gate of answers without an alignment, 0 if all are.
    """
    fit, limit = choice.fit, choice.limit
    queries, each = fit.queries, confidence_of_each(limit)
    mixed, off = queries.mixed, choice.off_map_scans
    right, on_map = fit.right, queries.on_map
    share_off = float(np.mean(~on_map[mixed]))
    kept, found = choice.answered - choice.wrong, int(right[mixed].sum())
    share, low, high = 1.0 - kept / found, *interval(found - kept, found, limit.confidence)
    before = ''
    if prior is not None:
        known = queries.judged(prior)
        before = f' (shipped coefficients: {_scores(logistic(known.log_odds), known.right)})'
    with_places = '' if queries.aligned is None else f', and aligned with the {queries.aligned.scores.shape[1]} nearest'
    few = ': too few squares to say more' if choice.squares < FEW_SQUARES else ''
    bounds = [
        upper_bound(count, total, each)
        for count, total in ((choice.wrong, choice.answered), (choice.off_map_answered, off))
    ]
    return [
        f'{queries.scans} scans of {queries.drives} drives, {queries.refused} refused; each is searched in both halves '
        f'of the map of another drive{with_places}: {int(right.sum())} of {int(on_map.sum())} answers on the map are '
        f'right, {int((~on_map).sum())} searches are off it',
        f'probability, learned from other stretches of the road than it judges: {_scores(fit.p_right, right)}{before}',
        f'min_probability {choice.min_probability:g}: {choice.wrong} of {choice.answered} answers are wrong '
        f'({choice.wrong / choice.answered:.4f}), with {share_off:.2f} of the scans off the map; '
        f'{choice.off_map_answered} of {off} scans off the map are answered ({choice.off_map_answered / off:.4f})',
        f'with confidence {limit.confidence:g}, at most {limit.error_rate:g} of the answers are wrong where at most '
        f'{share_off:.2f} of the scans are off the map, and at most {limit.off_map_rate:g} of the scans off the map '
        f'are answered (of this gate alone: {bounds[0]:.4f} and {bounds[1]:.4f})',
        f'rejected though right: {found - kept} of {found} answers ({share:.4f}; {low:.4f} to {high:.4f}, confidence '
        f'{limit.confidence:g})',
        f'counted by squares of {SQUARE_M:g} m of ground, {choice.squares} of them, not by scans, no more is certain '
        f'than {choice.error_rate_by_squares:.4f} of the answers wrong{few}',
        *([f'min_probability_unaligned {unaligned:g}: {_UNALIGNED[unaligned < 1.0]}'] if unaligned else []),
        f'rejected scans of a U above {threshold:.3f} are called uncertain',
        f'model {fingerprint[:12]}: query.model and query.confidence.model',
        ALIKE,
    ]


def _scores(p_right: NDArray[np.float64], right: NDArray[np.bool_]) -> str:
    return f'ECE {expected_calibration_error(p_right, right):.4f}, Brier score {brier_score(p_right, right):.4f}'


def threshold_lines(choice: ThresholdChoice, delta: float) -> list[str]:
    """What the threshold on U keeps; `delta` is Δ."""
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
        ALIKE,
    ]
