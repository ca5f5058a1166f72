"""Of two scans the worse one is to be the more uncertain."""

from __future__ import annotations

import torch
from torch.nn import functional


def ranking(uncertainties: torch.Tensor, badness: torch.Tensor, margin: float) -> torch.Tensor:
    """Scalar loss of (N,) U > 0 and (N,) how bad each scan is, in any unit, NaN where not known.

    L = Σ (b_i − b_j) softplus((log U_j − log U_i) / margin) / Σ (b_i − b_j) over pairs with b_i > b_j: how well U tells
    which of two is worse, mattering more the more they differ. 0 without such a pair.
    """
    worse = torch.nan_to_num(badness[:, None] - badness[None, :], nan=0.0).clamp(min=0.0)
    levels = uncertainties.log()
    order = functional.softplus((levels[None, :] - levels[:, None]) / margin)
    return (worse * order).sum() / worse.sum().clamp(min=1e-6)
