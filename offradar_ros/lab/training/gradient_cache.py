"""Gradients of a batch that is too large to pass the network at once (Gao et al., 2021).

A contrastive loss compares every view with every other, so that its gradient is not the sum of those of smaller
batches. But given the outputs of all views, each view's own part of the network is independent of the others. So the
outputs are computed first, in chunks and without a graph; then the gradient of the loss with respect to them; then each
chunk passes the network again, and its share of that gradient is propagated back. A chunk costs one forward pass more,
and memory is that of one chunk.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import torch
from torch import nn

from offradar_ros.lab.training.objective import Objective, Outputs, Views, total_of


def chunked_backward(
    objective: Objective,
    views: Views,
    step: int,
    chunk: int,
    precision: Callable[[], contextlib.AbstractContextManager[object]] = contextlib.nullcontext,
    scale: Callable[[torch.Tensor], torch.Tensor] = lambda total: total,
) -> dict[str, torch.Tensor]:
    """Add the gradients of a batch to the parameters, at most `chunk` views at once; returns the terms of the loss.

    The gradients are those of the graph of all chunks, to rounding. Each pass runs in a new `precision()`, for
    autocast, and the sum of the terms is multiplied by `scale` before it is propagated.

    Chunks are drawn at random, from torch's generator. Batch normalisation uses the statistics of each chunk
    ("ghost batches", Hoffer et al., 2017), which then tell a network nothing about which views belong together.
    Running statistics are updated once, in the second pass. Dropout and samples of Z are the same in both passes.
    """
    order = torch.randperm(len(views.images))
    parts = [part.to(views.images.device) for part in order.tensor_split(-(-len(order) // chunk))]
    seeds = torch.randint(2**62, (len(parts),)).tolist()

    def outputs_of(number: int) -> Outputs:
        torch.manual_seed(seeds[number])
        # A new context each time: autocast keeps the weights that it has converted, those of the first without a graph.
        with precision():
            return objective.outputs(views.images[parts[number]])

    with torch.no_grad(), _statistics_kept(objective.network):
        found = [outputs_of(number) for number in range(len(parts))]
        rows = torch.argsort(torch.cat(parts))
        whole = tuple(torch.cat(column)[rows] for column in zip(*found, strict=True))
    del found
    leaves = tuple(column.requires_grad_() for column in whole)
    with precision():
        terms = objective.losses(leaves, views, step)
    torch.autograd.backward(scale(total_of(terms)))
    for number, part in enumerate(parts):
        pairs = [
            (output, leaf.grad[part])
            for output, leaf in zip(outputs_of(number), leaves, strict=True)
            if output.requires_grad and leaf.grad is not None
        ]
        torch.autograd.backward([output for output, _ in pairs], [gradient for _, gradient in pairs])
    return terms


@contextlib.contextmanager
def _statistics_kept(network: nn.Module) -> Iterator[None]:
    """Leave the running statistics of batch normalisation as they are."""
    layers = [layer for layer in network.modules() if isinstance(layer, nn.BatchNorm2d)]
    for layer in layers:
        layer.track_running_stats = False
    try:
        yield
    finally:
        for layer in layers:
            layer.track_running_stats = True
