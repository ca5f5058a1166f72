"""U of clean scans is 1 in every world, and so with every radar."""

from __future__ import annotations

import torch


def clean_level(uncertainties: torch.Tensor, worlds: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Scalar loss of (N,) U > 0, (N,) int64 numbers of worlds, and (N,) bool, which scans count.

    L = mean over worlds w of the square of m_w, the expected log U of the scans that count. Each square is estimated
    without bias from the n scans of w, ((Σ log U)² − Σ (log U)²) / (n (n − 1)), so that it is the level of a world that
    is pulled to 0 and not the difference between its scans, which is the job of the other terms. An estimate may be
    below 0. Worlds with fewer than two such scans are left out; 0 without any other.
    """
    levels = uncertainties.log()
    squares = [
        (level.sum().square() - level.square().sum()) / (len(level) * (len(level) - 1))
        for level in (levels[counts & (worlds == world)] for world in sorted(set(worlds.tolist())))
        if len(level) > 1
    ]
    return torch.stack(squares).mean() if squares else levels.sum() * 0.0
