"""Checkpoints: the state of a run in one safetensors file, tensors and a JSON header. Nothing is pickled."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import torch
from safetensors.torch import load, save
from torch import nn

from offradar_ros.bounded_input import parse_json
from offradar_ros.encoders.model_files import first_line, write_atomically
from offradar_ros.encoders.safetensors_file import BLANK, read_safetensors, with_digest
from offradar_ros.errors import ConfigError, ModelError
from offradar_ros.records import structure, unstructure

_STATE = 'offradar.training'


@dataclasses.dataclass(frozen=True)
class Progress:
    """State of a run beside its tensors.

    Attributes:
        step: steps done.
        best_score: the highest validation score so far; −1 before the first validation.
        best_step: steps done at that validation; −1 before the first.
        scaler: state of the loss scaler, for fp16.
        config: every key with its value, as nested mappings.
    """

    step: int
    best_score: float
    best_step: int
    scaler: Mapping[str, Any]
    config: Mapping[str, Any]


def save_checkpoint(
    path: Path,
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    progress: Progress,
    average: nn.Module | None = None,
) -> None:
    """Write all that a resumed run needs to give the same result. Batches and samples follow from seed and step.

    `average` has the averaged weights of `network`, if there are any.
    """
    tensors = {f'network.{name}': tensor for name, tensor in network.state_dict().items()}
    if average is not None:
        tensors |= {f'average.{name}': tensor for name, tensor in average.state_dict().items()}
    for number, state in optimiser.state_dict()['state'].items():
        tensors |= {f'optimiser.{number}.{key}': torch.as_tensor(value) for key, value in state.items()}
    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {_STATE: json.dumps(unstructure(progress)), **BLANK}
    write_atomically(path, with_digest(save(contiguous, metadata=metadata)))


def read_progress(path: Path) -> Progress:
    """The progress in a checkpoint; ModelError for a missing file and for one that is not a checkpoint."""
    return _read(path)[1]


def _read(path: Path) -> tuple[bytes, Progress]:
    if not path.is_file():
        raise ModelError(f'{path}: no such checkpoint')
    content, metadata = read_safetensors(path)
    try:
        return content, structure(Progress, parse_json(metadata[_STATE]))
    except (KeyError, ValueError, ConfigError) as error:
        raise ModelError(f'{path}: not a checkpoint of a training run ({first_line(error)})') from error


def load_checkpoint(
    path: Path, network: nn.Module, optimiser: torch.optim.Optimizer, average: nn.Module | None = None
) -> Progress:
    """Load the tensors of a checkpoint into `network`, `optimiser` and `average`; ModelError if they do not fit."""
    content, progress = _read(path)
    try:
        tensors = load(content)
        network.load_state_dict(_part(tensors, 'network.'))
        if average is not None:
            average.load_state_dict(_part(tensors, 'average.'))
        _load_optimiser(optimiser, _part(tensors, 'optimiser.'))
    except (safetensors.SafetensorError, RuntimeError, TypeError, KeyError, ValueError, IndexError) as error:
        raise ModelError(f'{path}: does not fit the configured network ({first_line(error)})') from error
    return progress


def _part(tensors: Mapping[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _load_optimiser(optimiser: torch.optim.Optimizer, tensors: Mapping[str, torch.Tensor]) -> None:
    parameters = [parameter for group in optimiser.param_groups for parameter in group['params']]
    states: dict[int, dict[str, torch.Tensor]] = {}
    for name, tensor in tensors.items():
        number, _, key = name.partition('.')
        like = parameters[int(number)]
        # With the memory layout of the parameter, a step uses the same kernels as before.
        value = torch.empty_like(like).copy_(tensor) if tensor.shape == like.shape and tensor.dim() else tensor
        states.setdefault(int(number), {})[key] = value
    optimiser.load_state_dict({**optimiser.state_dict(), 'state': states})
