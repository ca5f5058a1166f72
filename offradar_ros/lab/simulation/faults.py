"""Which scans of a drive are degraded, and how."""

from __future__ import annotations

import numpy as np

from offradar_ros.lab.simulation.degradation import Degradation
from offradar_ros.lab.simulation.session_plan import SessionPlan

MIN_SEVERITY = 0.05
_ROWS = 400


def draw_degradations(plan: SessionPlan) -> tuple[Degradation | None, ...]:
    """One entry per scan, None for a clean one. Kinds, severities and azimuths are drawn uniformly."""
    rng = np.random.default_rng([plan.seed, 2])
    faults: list[Degradation | None] = [None] * plan.scans
    for index in sorted(rng.permutation(plan.scans)[: round(plan.degraded * plan.scans)].tolist()):
        kind = plan.kinds[int(rng.integers(len(plan.kinds)))]
        faults[index] = Degradation(kind, float(rng.uniform(MIN_SEVERITY, 1.0)), int(rng.integers(_ROWS)))
    return tuple(faults)
