"""Of two scans the one that is more badly degraded is to be the more uncertain."""

from __future__ import annotations

import torch
from torch.nn import functional


def severity_ranking(uncertainties: torch.Tensor, severities: torch.Tensor, margin: float) -> torch.Tensor:
    """Scalar loss of (N,) U > 0 and (N,) severities 0 to 1, NaN where not known.

    L = Σ |s_i − s_j| softplus((log U_j − log U_i) / margin) / Σ |s_i − s_j| over pairs with s_i > s_j: how well U tells
    which of two is worse, mattering more the more they differ. 0 without such a pair.
    """
    worse = torch.nan_to_num(severities[:, None] - severities[None, :], nan=0.0).clamp(min=0.0)
    levels = uncertainties.log()
    order = functional.softplus((levels[None, :] - levels[:, None]) / margin)
    return (worse * order).sum() / worse.sum().clamp(min=1e-6)
