"""The static thresholds on the U of a method, from validation drives."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offradar_ros.calibration.variance_scale import largest_deviation
from offradar_ros.lab.evaluation.protocol import Validation
from offradar_ros.records import Measure
from offradar_ros.retrieval.thresholds import static_thresholds


class Deployed(NamedTuple):
    """A threshold in use, NaN for none, and the fingerprint of the model that it is for, empty for any."""

    threshold: float = math.nan
    model: str = ''

    def of(self, fingerprint: str) -> float:
        """The threshold for the model of this fingerprint; NaN if it is for another one, whose U has another scale."""
        return self.threshold if self.model in ('', fingerprint) else math.nan


NOT_DEPLOYED = Deployed()


@dataclasses.dataclass(frozen=True)
class Thresholds:
    """Thresholds on U: `static` ascending, empty without validation drives; `deployed`, that in use, NaN for none."""

    static: tuple[Measure, ...] = ()
    deployed: Measure = math.nan


def thresholds_from(uncertainties: Sequence[float], validation: Validation, given: float = math.nan) -> Thresholds:
    """Thresholds from U over validation drives (Sec. III-C of the paper): Δ is the largest |U − 1|, N is `levels`.

    The threshold in use is `given`, or else the quantile of U that `validation` names.
    """
    known = np.asarray(uncertainties, np.float64)
    known = known[np.isfinite(known)]
    if not len(known):
        return Thresholds((), given)
    static = static_thresholds(largest_deviation(known), validation.levels)
    deployed = float(np.quantile(known, validation.quantile)) if math.isnan(given) else given
    return Thresholds(tuple(static.tolist()), deployed)
