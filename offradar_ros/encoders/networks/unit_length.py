"""Vectors to length one. Needs torch."""

from __future__ import annotations

import torch

_SHORTEST = 1e-12


def unit_length(vectors: torch.Tensor) -> torch.Tensor:
    """(…, d) → (…, d) of length 1 along the last axis, zeros where all is zero; its ONNX keeps the shape known."""
    lengths: torch.Tensor = torch.linalg.vector_norm(vectors, dim=-1, keepdim=True)
    return vectors / lengths.clamp_min(_SHORTEST)
