"""Muon (Jordan et al., 2024): the momentum of each matrix of weights is made orthogonal before it is applied."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch

# Coefficients of Jordan's iteration: five steps bring singular values of 0.002 to 1 to between 0.68 and 1.2.
_ITERATION = (3.4445, -4.7750, 2.0315)
_ITERATIONS = 5
_MOMENTUM = 0.95
_TINY = 1e-7


class Muon(torch.optim.AdamW):
    """Matrices and kernels take steps of orthogonal momentum, all other parameters those of AdamW.

    The step of a matrix W of m × n is −ηr √max(1, m/n) O, where O ≈ U Vᵀ for the momentum U S Vᵀ: all directions of the
    gradient count alike, large and small ones. η is `lr`, r is `matrix_rate` over the rate that is given here, and a
    kernel is a matrix with a row for each output. `torch.optim.Muon` takes no kernels, and computes in bfloat16, which
    many processors emulate.
    """

    def __init__(
        self, parameters: Iterable[torch.nn.Parameter], lr: float, matrix_rate: float, weight_decay: float
    ) -> None:
        super().__init__(parameters, lr=lr, weight_decay=weight_decay, fused=True)
        # A step with gradients that are not finite is then left out as a whole, not by AdamW alone.
        self._step_supports_amp_scaling = False
        self._share = matrix_rate / lr if lr else 0.0

    def step(self, closure: Callable[[], float] | None = None) -> None:  # type: ignore[override]
        """One step; gradients of matrices and kernels are None afterwards. `closure` is not supported."""
        if closure is not None:
            raise ValueError('Muon takes no closure')
        for group in self.param_groups:
            for weight in group['params']:
                if weight.grad is not None and weight.dim() >= 2:
                    self._step_matrix(weight, weight.grad, group['lr'] * self._share, group['weight_decay'])
                    # AdamW leaves out what has no gradient.
                    weight.grad = None
        super().step()

    @torch.no_grad()
    def _step_matrix(
        self, weight: torch.nn.Parameter, gradient: torch.Tensor, rate: float, weight_decay: float
    ) -> None:
        state = self.state[weight]
        if not state:
            # AdamW reads the number of steps of every state that it loads.
            state['step'] = torch.zeros(())
            state['momentum'] = torch.zeros_like(weight)
        state['step'] += 1.0
        state['momentum'].lerp_(gradient, 1.0 - _MOMENTUM)
        ahead = gradient.lerp(state['momentum'], _MOMENTUM)
        matrix = ahead.reshape(len(ahead), -1)
        step = orthogonal(matrix) * max(1.0, matrix.shape[0] / matrix.shape[1]) ** 0.5
        weight.mul_(1.0 - rate * weight_decay)
        weight.sub_(step.reshape(weight.shape), alpha=rate)


def orthogonal(matrix: torch.Tensor) -> torch.Tensor:
    """U Vᵀ, roughly, of (m, n) U S Vᵀ: the singular values become about 1.

    Newton-Schulz iteration X ← a X + b G X + c G² X, G = X Xᵀ. Every iterate is a polynomial in the first G times the
    first X, so that only the products of the shorter side squared are iterated.
    """
    wide = matrix.T if matrix.shape[0] > matrix.shape[1] else matrix
    wide = wide / (wide.norm() + _TINY)
    first, second, third = _ITERATION
    gram = wide @ wide.T
    unit = torch.eye(len(gram), dtype=gram.dtype, device=gram.device)
    product = unit
    for _ in range(_ITERATIONS):
        factor = first * unit + second * gram + third * (gram @ gram)
        product = factor @ product
        gram = factor @ gram @ factor
    result: torch.Tensor = product @ wide
    return result.T if matrix.shape[0] > matrix.shape[1] else result
