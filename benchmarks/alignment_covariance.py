"""Fits the covariance of an alignment to the errors on the worlds of a protocol: see README.md.

The constants come on top of those that `align` has already: a scale near 1 and no floors confirm them.
"""

from __future__ import annotations

import math

import numpy as np
from embedded_worlds import options_of, worlds_parser
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import chi2
from verification import PLACES

from offradar_ros.lab.evaluation.aligned import AlignedAnswers, answers_of_worlds, joined_answers
from offradar_ros.lab.evaluation.alignment_figures import is_right, squared
from offradar_ros.lab.evaluation.confidence import embed
from offradar_ros.lab.evaluation.protocol_file import read_protocol

WITHIN_M = 15.0
"""Places farther from the query than this are left out."""
HELD = 0.95


def main() -> None:
    """Print the constants, and the share of errors in the ellipsoids before and after."""
    parser = worlds_parser(__doc__)
    parser.add_argument('--queries', type=int, default=8, help='scans of each drive that are searched in each map')
    arguments = parser.parse_args()
    protocol = read_protocol(arguments.protocol)
    _, worlds = embed(protocol, arguments.method, options_of(arguments))
    spacings_m = protocol.map_spacings_m
    made = answers_of_worlds(worlds.values(), protocol, spacings_m, places=PLACES, queries=arguments.queries)
    answers = joined_answers(made)
    errors, covariances = sound_errors(answers)
    print(f'{len(errors)} alignments; {held(errors, covariances):.1%} in the ellipsoid of {HELD:.0%} as it is')
    scale, floor_m, floor_rad = fitted(errors, covariances)
    after = scaled(covariances, scale, floor_m, floor_rad)
    print(f'scale {scale:.3f}, floor {floor_m:.4f} m and {math.degrees(floor_rad):.4f}°: {held(errors, after):.1%}')


def sound_errors(answers: AlignedAnswers) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 3) errors and (N, 3, 3) covariances of alignments that are not wrong altogether."""
    chosen = is_right(answers.errors) & (answers.away_m <= WITHIN_M)
    return answers.errors[chosen], answers.covariances[chosen]


def scaled(covariances: NDArray[np.float64], scale: float, floor_m: float, floor_rad: float) -> NDArray[np.float64]:
    """(N, 3, 3) ``scale² Σ + diag(floor_m², floor_m², floor_rad²)``."""
    return scale**2 * covariances + np.diag([floor_m**2, floor_m**2, floor_rad**2])


def held(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> float:
    """Share of the errors in their ellipsoids."""
    return float((squared(errors, covariances) <= chi2.ppf(HELD, 3)).mean())


def fitted(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> tuple[float, float, float]:
    """Scale, and floors in metres and radians: of highest likelihood, then grown together until the share holds."""

    def loss(logs: NDArray[np.float64]) -> float:
        after = scaled(covariances, *np.exp(logs).tolist())
        return float(np.mean(np.linalg.slogdet(after)[1] + squared(errors, after)))

    found = minimize(loss, np.log([2.0, 0.05, 0.002]), method='Nelder-Mead', options={'maxiter': 400})
    scale, floor_m, floor_rad = np.exp(found.x).tolist()
    growth = math.sqrt(
        float(np.quantile(squared(errors, scaled(covariances, scale, floor_m, floor_rad)), HELD)) / chi2.ppf(HELD, 3)
    )
    return scale * growth, floor_m * growth, floor_rad * growth


if __name__ == '__main__':
    main()
