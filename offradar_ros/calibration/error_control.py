"""Bounds on a counted share, and the tests that show which thresholds keep wrong answers rare.

Exact binomial bounds: Clopper and Pearson, Biometrika 26 (1934). The choice of a threshold is a test of each, as in
Angelopoulos et al., "Learn then Test", arXiv 2110.01052 (2021). scipy is imported when a bound is computed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LEAST_CONFIDENCE = 0.75
"""From here on the exact bound also holds for scans that are not all equally likely to be answered wrongly.

Hoeffding (1956): unequal chances spread a count less than equal ones do, below its mean less 1; no count above that is
rejected at 1/4 or less (Greenberg and Mohri, "Tight lower bound on the probability of a binomial", 2014).
"""


def upper_bound(count: int, total: int, confidence: float) -> float:
    """One-sided upper bound on the share that `count` of `total` estimates, Clopper–Pearson; 1 if all count."""
    from scipy.special import betaincinv  # noqa: PLC0415

    return 1.0 if count >= total else float(betaincinv(count + 1, total - count, confidence))


def interval(count: int, total: int, confidence: float) -> tuple[float, float]:
    """Confidence interval of the share `count` of `total`; each end is wrong with half of 1 − confidence."""
    one_sided = (1.0 + confidence) / 2.0
    return 1.0 - upper_bound(total - count, total, one_sided), upper_bound(count, total, one_sided)


def fewest_answers(error_rate: float, confidence: float) -> int:
    """Fewest answers that, all right, bound the share of wrong ones by `error_rate`: ⌈ln(1 − c) / ln(1 − ε)⌉."""
    return math.ceil(math.log(1.0 - confidence) / math.log(1.0 - error_rate) - 1e-9)


class ErrorLimit(NamedTuple):
    """What is wanted, with `confidence` of all of it.

    Attributes:
        error_rate: at most this share of the answers is wrong.
        confidence: chance that this is kept.
        off_map_rate: at most this share of the scans off the map is answered; for the gate on the probability.
    """

    error_rate: float
    confidence: float
    off_map_rate: float = 0.01


class Counts(NamedTuple):
    """Counts at M ascending thresholds.

    Attributes:
        answered: (M,) int64 scans that are answered.
        wrong: (M,) int64 answers among them that are wrong.
    """

    answered: NDArray[np.int64]
    wrong: NDArray[np.int64]


def counts_at(uncertainties: NDArray[np.float64], wrong: NDArray[np.bool_], thresholds: NDArray[np.float64]) -> Counts:
    """Counts of (Q,) scans at (M,) thresholds; a scan is answered where its U is at most the threshold."""
    order = np.argsort(uncertainties, kind='stable')
    answered = np.searchsorted(uncertainties[order], thresholds, side='right').astype(np.int64)
    mistakes = np.concatenate([[0], np.cumsum(wrong[order], dtype=np.int64)])
    return Counts(answered, mistakes[answered])


def passing(counts: Counts, error_rate: float, confidence: float) -> NDArray[np.bool_]:
    """(M,) bool: the thresholds at which at most `error_rate` of the answers are wrong, all at once with `confidence`.

    The hypothesis of each threshold is that more are wrong. Its p-value is P(Bin(answered, error_rate) ≤ wrong). They
    are tested from the lowest threshold upwards by the fallback procedure (Wiens, Pharmaceutical Statistics 2, 2003; a
    sequential graphical test in Learn then Test). A threshold is tested at its own share of 1 − confidence, plus the
    level of the threshold below it if that one passed. The shares depend on the numbers of answers alone, not on which
    of them are right:

    * one half goes to the first threshold that passes if no answer is wrong;
    * one half to the first that passes even if half of `error_rate` of them are wrong. Without it, a single wrong
      answer among the first few would end the tests.

    If there is no second one, the first gets all of it. Thresholds below the first answer too few scans to pass, and
    are not tested.
    """
    from scipy.stats import binom  # noqa: PLC0415

    shares = _shares(counts.answered, error_rate, 1.0 - confidence)
    chances = binom.cdf(counts.wrong, counts.answered, error_rate)
    passed = np.zeros(len(shares), np.bool_)
    inherited = 0.0
    for level, share in enumerate(shares.tolist()):
        level_of_test = share + inherited
        passed[level] = level_of_test > 0.0 and bool(chances[level] <= level_of_test)
        inherited = level_of_test if passed[level] else 0.0
    return passed


def _shares(answered: NDArray[np.int64], error_rate: float, significance: float) -> NDArray[np.float64]:
    """(M,) the share of `significance` = 1 − confidence at which each threshold is tested by itself."""
    shares = np.zeros(len(answered))
    strict = _first_able(answered, 0.0, error_rate, significance / 2.0)
    lenient = _first_able(answered, error_rate / 2.0, error_rate, significance / 2.0)
    if strict is not None and lenient is not None and strict != lenient:
        shares[[strict, lenient]] = significance / 2.0
        return shares
    alone = _first_able(answered, 0.0, error_rate, significance)
    if alone is not None:
        shares[alone] = significance
    return shares


def _first_able(answered: NDArray[np.int64], rate: float, error_rate: float, significance: float) -> int | None:
    """The first threshold that would pass at `significance` with this rate of wrong answers."""
    from scipy.stats import binom  # noqa: PLC0415

    able = binom.cdf(np.floor(answered * rate), answered, error_rate) <= significance
    able &= answered > 0
    return int(np.argmax(able)) if able.any() else None
