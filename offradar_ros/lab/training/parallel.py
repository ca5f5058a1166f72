"""Several processes of one run, as ``torchrun`` starts them; one process alone is a group of one."""

from __future__ import annotations

import contextlib
import datetime
import os
from collections.abc import Callable, Iterator

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.objective import Objective, Views

Losses = Callable[[Views, int], dict[str, torch.Tensor]]
"""`Objective.losses`."""


class Group:
    """This process's place among all of a run."""

    def __init__(self, rank: int, size: int, device: torch.device) -> None:
        self.rank = rank
        self.size = size
        self.device = device

    def data_parallel(self, objective: Objective) -> Losses:
        """`objective.losses`, for a network on this process's device.

        With several processes the gradients that follow are means over them, and each call starts from the first one's
        buffers (batch statistics), so that one checkpoint stands for all.
        """
        if self.size == 1:
            return objective.losses
        # Which parameters a run's terms use does not change; those of a term of weight 0 keep no gradient.
        return DistributedDataParallel(_LossModule(objective), static_graph=True)

    def first_says(self, numbers: tuple[float, ...]) -> tuple[float, ...]:
        """The first process's numbers, in all; all have to ask, and go on when the first has."""
        if self.size == 1:
            return numbers
        sent = torch.tensor(numbers, dtype=torch.float64, device=self.device)
        distributed.broadcast(sent, src=0)
        return tuple(sent.tolist())

    def any(self, here: bool) -> bool:
        """Whether it is so in any process; all have to ask."""
        if self.size == 1:
            return here
        flag = torch.tensor(float(here), device=self.device)
        distributed.all_reduce(flag, distributed.ReduceOp.MAX)
        return bool(flag.item())


class _LossModule(nn.Module):
    """An objective as a module, whose forward pass ends in the losses: what DistributedDataParallel wraps."""

    def __init__(self, objective: Objective) -> None:
        super().__init__()
        self.network = objective.network
        self._losses = objective.losses

    def forward(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        return self._losses(views, step)


@contextlib.contextmanager
def joined_group(device: str) -> Iterator[Group]:
    """The group that this process belongs to, by the environment that ``torchrun`` sets.

    `device` is ``auto``, ``cpu`` or ``cuda``; each process of a machine takes the GPU of its number. ConfigError for a
    GPU where there is none.
    """
    if device == 'cuda' and not torch.cuda.is_available():
        raise ConfigError('--device cuda: there is no GPU that torch can use')
    on_gpu = device == 'cuda' or (device == 'auto' and torch.cuda.is_available())
    place = torch.device('cuda', int(os.environ.get('LOCAL_RANK', '0'))) if on_gpu else torch.device('cpu')
    # Every batch has the same shape: the fastest kernels are worth looking for.
    torch.backends.cudnn.benchmark = on_gpu
    size = int(os.environ.get('WORLD_SIZE', '1'))
    if size == 1:
        yield Group(0, 1, place)
        return
    if on_gpu:
        torch.cuda.set_device(place)
    # The others wait while the first makes the cache.
    distributed.init_process_group('nccl' if on_gpu else 'gloo', timeout=datetime.timedelta(days=1))
    try:
        yield Group(distributed.get_rank(), size, place)
    finally:
        distributed.destroy_process_group()
