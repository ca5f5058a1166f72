"""Match probability averaged over samples, as in hedged instance embeddings (Oh et al., ICLR 2019)."""

from __future__ import annotations

import math

import torch

from offradar_ros.lab.training.losses.cosines import cosines, other_views


def hedged_contrast(
    centres: torch.Tensor,
    log_variances: torch.Tensor,
    temperature: float,
    samples: int,
    generator: torch.Generator | None = None,
) -> torch.Tensor:
    """Scalar loss of (2m, d) centres with (2m, d) log variances; points are sampled, then L2-normalised here.

    L = −1/2m Σ_i log 1/S Σ_s softmax_{j ≠ i}(cos(z_i^s, z_j^s) / τ) at i', z^s ~ N(centre, σ²): the log of the mean
    over S samples, not the mean of the logs, so that a scan needs to match in some of the samples only.
    """
    count = len(centres)
    other = other_views(count, centres.device)
    itself = torch.eye(count, dtype=torch.bool, device=centres.device)
    deviations = torch.exp(0.5 * log_variances)
    matched = []
    for _ in range(samples):
        noise = torch.randn(centres.shape, generator=generator, dtype=centres.dtype, device=centres.device)
        logits = cosines(centres + deviations * noise) / temperature
        log_probabilities = logits.masked_fill(itself, -torch.inf).log_softmax(dim=1)
        matched.append(log_probabilities.gather(1, other[:, None])[:, 0])
    return math.log(samples) - torch.logsumexp(torch.stack(matched), dim=0).mean()
