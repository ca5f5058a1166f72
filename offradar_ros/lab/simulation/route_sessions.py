"""Sessions on one route: each a day later, with another lane offset, other traffic and other noise."""

from __future__ import annotations

from offradar_ros.lab.simulation.session_plan import SessionPlan

DAY_NS = 24 * 3600 * 10**9
LANES_M = (0.0, 1.0, -0.8, 0.5, -1.2)


def session_plan(index: int, *, scans: int, seed: int, degraded: float) -> SessionPlan:
    """The plan of session `index`, which counts from 0; `degraded` is the share of its scans that are degraded."""
    return SessionPlan(
        name=f'session_{index + 1}',
        seed=1000 * seed + index,
        scans=scans,
        left_m=LANES_M[index % len(LANES_M)],
        degraded=degraded,
        start_ns=SessionPlan().start_ns + index * DAY_NS,
    )
