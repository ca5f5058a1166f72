"""L2-normalise vectors. Needs torch."""

from __future__ import annotations

import torch

_SMALLEST_NORM = 1e-12


def l2_normalise(vectors: torch.Tensor) -> torch.Tensor:
    """(…, d) → (…, d) of L2 norm 1 along the last axis, zeros where all is zero.

    Equal to `torch.nn.functional.normalize`, but that exports two more ONNX nodes, Shape and Expand, although the
    division broadcasts, and so shapes that are known at run time only.
    """
    norms: torch.Tensor = torch.linalg.vector_norm(vectors, dim=-1, keepdim=True)
    return vectors / norms.clamp_min(_SMALLEST_NORM)
