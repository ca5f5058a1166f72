"""Several processes of one run, as ``torchrun`` starts them; one process alone is a group of one."""

from __future__ import annotations

import contextlib
import datetime
import os
from collections.abc import Iterable, Iterator

import torch
from torch import distributed

from offradar_ros.errors import ConfigError


class Group:
    """This process's place among all of a run."""

    def __init__(self, rank: int, size: int, device: torch.device) -> None:
        self.rank = rank
        self.size = size
        self.device = device

    def average_gradients(self, parameters: Iterable[torch.nn.Parameter]) -> None:
        """Replace each gradient by its mean over the processes."""
        if self.size == 1:
            return
        for parameter in parameters:
            if parameter.grad is not None:
                distributed.all_reduce(parameter.grad)
                parameter.grad /= self.size

    def share_buffers(self, network: torch.nn.Module) -> None:
        """Give all processes the first one's buffers (running means), so that one checkpoint stands for all."""
        if self.size > 1:
            for buffer in network.buffers():
                distributed.broadcast(buffer, src=0)

    def first_says(self, numbers: tuple[float, ...]) -> tuple[float, ...]:
        """The first process's numbers, in all; all have to ask, and go on when the first has."""
        if self.size == 1:
            return numbers
        told = torch.tensor(numbers, dtype=torch.float64, device=self.device)
        distributed.broadcast(told, src=0)
        return tuple(told.tolist())

    def any(self, here: bool) -> bool:
        """Whether it is so in any process; all have to ask."""
        if self.size == 1:
            return here
        flag = torch.tensor(float(here), device=self.device)
        distributed.all_reduce(flag, distributed.ReduceOp.MAX)
        return bool(flag.item())


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
