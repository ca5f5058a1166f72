"""Data-parallel training by several processes, as ``torchrun`` starts them; one process is a group of one."""

from __future__ import annotations

import contextlib
import datetime
import functools
import gc
import os
from collections.abc import Callable, Iterator

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.objective import Objective, Views, losses_of

Losses = Callable[[Views, int], dict[str, torch.Tensor]]
"""`losses_of` an objective."""


class Group:
    """This process among all processes of a run: its rank, their number, and its device."""

    def __init__(self, rank: int, size: int, device: torch.device) -> None:
        self.rank = rank
        self.size = size
        self.device = device
        self._parallel: DistributedDataParallel | None = None

    def data_parallel(self, objective: Objective) -> Losses:
        """`losses_of` an objective whose network is on this process's device.

        With several processes gradients are averaged over them, and each call starts from the first one's buffers
        (batch statistics), so that its checkpoint is valid for all. Called again after parameters were frozen.
        """
        if self.size == 1:
            return functools.partial(losses_of, objective)
        self.release()
        # The parameters that are used do not change until the next call; those of a term of weight 0 have no gradient.
        self._parallel = DistributedDataParallel(_LossModule(objective), static_graph=True)
        return self._parallel_losses

    def _parallel_losses(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        assert self._parallel is not None, 'the group has ended'
        losses: dict[str, torch.Tensor] = self._parallel(views, step)
        return losses

    def release(self) -> None:
        """Let go of the network: one that outlives the group of processes may abort its process at exit."""
        self._parallel = None
        gc.collect()

    def broadcast(self, numbers: tuple[float, ...]) -> tuple[float, ...]:
        """The numbers of the first process, in all processes. All must call this, and wait for the first."""
        if self.size == 1:
            return numbers
        sent = torch.tensor(numbers, dtype=torch.float64, device=self.device)
        distributed.broadcast(sent, src=0)
        return tuple(sent.tolist())

    def any(self, value: bool) -> bool:
        """Whether `value` is true in any process. All must call this."""
        if self.size == 1:
            return value
        flag = torch.tensor(float(value), device=self.device)
        distributed.all_reduce(flag, distributed.ReduceOp.MAX)
        return bool(flag.item())


class _LossModule(nn.Module):
    """An objective as a module, whose forward pass ends in the losses: what DistributedDataParallel wraps."""

    def __init__(self, objective: Objective) -> None:
        super().__init__()
        self.network = objective.network
        self._losses = functools.partial(losses_of, objective)

    def forward(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        return self._losses(views, step)


@contextlib.contextmanager
def process_group(device: str) -> Iterator[Group]:
    """The group of this process, from the environment that ``torchrun`` sets.

    `device` is ``auto``, ``cpu`` or ``cuda``; each process of a machine uses the GPU of its local rank. ConfigError
    if ``cuda`` is not available.
    """
    if device == 'cuda' and not torch.cuda.is_available():
        raise ConfigError('--device cuda: there is no GPU that torch can use')
    on_gpu = device == 'cuda' or (device == 'auto' and torch.cuda.is_available())
    place = torch.device('cuda', int(os.environ.get('LOCAL_RANK', '0'))) if on_gpu else torch.device('cpu')
    # All batches have the same shape, so benchmarking of kernels pays off.
    torch.backends.cudnn.benchmark = on_gpu
    size = int(os.environ.get('WORLD_SIZE', '1'))
    if size == 1:
        yield Group(0, 1, place)
        return
    if on_gpu:
        torch.cuda.set_device(place)
    # The other processes wait while the first makes the cache.
    distributed.init_process_group('nccl' if on_gpu else 'gloo', timeout=datetime.timedelta(days=1))
    group = Group(distributed.get_rank(), size, place)
    try:
        yield group
    finally:
        group.release()
        distributed.destroy_process_group()
