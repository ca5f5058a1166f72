"""What a trained network gives to the scans of training drives: the targets of distillation, computed once.

A run sees each scan many times, turned at random. The teacher does not depend on the turn but for aliasing (`compact`),
so that one pass for each scan as it was recorded replaces one for each view. For 100,000 scans and d = 128 its outputs
are 51 MB.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.files import load_network
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.errors import ConfigError, DataError, ModelError
from offradar_ros.lab.array_file import read_array, write_array
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.config import DistillationConfig
from offradar_ros.lab.training.images import images_of
from offradar_ros.processes import Progress

_IMAGES_AT_ONCE = 64


@dataclasses.dataclass(frozen=True)
class Teacher:
    """A trained network in evaluation mode, and the fingerprint of its weights."""

    network: VariationalNetwork
    fingerprint: str


def weights_of(config: DistillationConfig) -> Path:
    """The file of the teacher's weights; ConfigError for neither a file of weights nor the name of shipped ones."""
    return find_weights(config.weights, ('.safetensors',), 'key distillation.weights')


def load_teacher(config: DistillationConfig, student: NetworkConfig) -> Teacher:
    """The teacher of a student.

    ConfigError for a student, ModelError for weights, that are not `variational`, or for those of another dimension.
    """
    if student.method != 'variational':
        raise ConfigError(f'key distillation.weights: expected none, as {student.method} is not distilled')
    path = weights_of(config)
    network, header = load_network(path)
    if not isinstance(network, VariationalNetwork) or network.config.dimension != student.dimension:
        raise ModelError(
            f'{path}: expected a variational network of dimension {student.dimension} as the teacher, '
            f'got {header.config.method} of {header.config.dimension}'
        )
    return Teacher(network.requires_grad_(False), header.fingerprint)


def teacher_outputs(
    teacher: Teacher,
    drives: Sequence[Drive],
    cache: Path,
    device: torch.device,
    threads: int = 0,
    progress: Progress | None = None,
    check: Callable[[], None] | None = None,
) -> NDArray[np.float16]:
    """(N, 2, d) float16 unit descriptor and log variance of the N scans of all drives, not turned.

    Those of each drive are kept in `cache`, in a folder of the teacher's name, and are computed if they are not there.
    `check` is called between drives and may raise KeyboardInterrupt. DataError for a file that cannot be used.
    """
    folder = cache / f'teacher-{teacher.fingerprint[:16]}'
    network = teacher.network.to(device)
    found = []
    for number, drive in enumerate(drives, start=1):
        path = folder / f'{drive.key}.npy'
        shape = (len(drive), 2, network.config.dimension)
        try:
            if not path.is_file():
                folder.mkdir(parents=True, exist_ok=True)
                write_array(path, _outputs_of(network, drive, device, threads))
            outputs = read_array(path)
        except OSError as error:
            raise DataError(f'{path}: cannot be written or read ({error.strerror or error})') from error
        except ValueError as error:
            raise DataError(f'{path}: damaged ({error}): remove it to make it again') from error
        if outputs.shape != shape or outputs.dtype != np.float16:
            raise DataError(f'{path}: expected float16 of {shape}, got {outputs.dtype} of {outputs.shape}: remove it')
        found.append(outputs)
        if progress:
            progress(number, len(drives))
        if check:
            check()
    return np.concatenate(found)


def _outputs_of(network: VariationalNetwork, drive: Drive, device: torch.device, threads: int) -> NDArray[np.float16]:
    images = torch.from_numpy(images_of(drive, network.config, threads))
    parts = []
    with torch.inference_mode():
        for part in torch.split(images, _IMAGES_AT_ONCE):
            descriptors, variances = network.embed(part.to(device))
            parts.append(torch.stack([descriptors, variances.log()], dim=1).half().cpu())
    return np.asarray(torch.cat(parts).numpy(), np.float16)
