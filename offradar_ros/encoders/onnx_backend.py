"""Runs an exported network with ONNX Runtime, on a GPU if that provider is installed. Needs no torch."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from offradar_ros.encoders.device import CPU_PROVIDER, CUDA_PROVIDER, cuda_unavailable, onnx_providers, used_device
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.model_files import first_line
from offradar_ros.encoders.onnx_model import read_onnx
from offradar_ros.errors import ModelError

WARNINGS_OFF = 3


class OnnxEncoder(ImageEncoder):
    """Learned encoder in ONNX Runtime; ModelError for a file that is missing, damaged or not from `export_onnx`."""

    def __init__(self, path: str | Path, threads: int = 0, device: str = 'auto') -> None:
        """`threads` of one inference on a CPU, 0 uses every core; `device` as the parameter `encoder.device`.

        ConfigError for ``cuda`` without a GPU.
        """
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or _cores()
        options.log_severity_level = WARNINGS_OFF
        # Spinning threads, which wait for the next scan, take several times the CPU time of the computation.
        options.add_session_config_entry('session.intra_op.allow_spinning', '0')
        providers = onnx_providers(device, onnxruntime.get_available_providers())
        model = read_onnx(path)
        self._session = _session(model.content, path, options, providers, device)
        super().__init__(model.header, path, used_device(device, self._session.get_providers()))
        self._expect_shapes(path)
        try:
            self.require_sound(model.probe)
        except ModelError:
            raise
        except Exception as error:  # its exceptions have no common base class
            raise _cannot_run(path, error) from error

    def infer(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Images (N, H, W) uint8 → mean and variance, both (N, d) float32."""
        mean, variance = self._session.run(['mean', 'variance'], {'images': images})
        return mean, variance

    def _expect_shapes(self, path: str | Path) -> None:
        config = self.header.config
        expected = {
            'images': ('tensor(uint8)', list(config.image_shape)),
            'mean': ('tensor(float)', [config.dimension]),
            'variance': ('tensor(float)', [config.dimension]),
        }
        nodes = [*self._session.get_inputs(), *self._session.get_outputs()]
        found = {node.name: (node.type, list(node.shape[1:])) for node in nodes}
        if found != expected:
            raise ModelError(f'{path}: expected inputs and outputs {expected}, got {found}')


def _cores() -> int:
    """Number of cores that the process may use (``taskset``); the two threads of a core count once.

    ONNX Runtime counts them too, but binds a thread to each of them: one whose core is taken waits, and the whole
    inference with it, though another core is free.
    """
    cpus = os.sched_getaffinity(0)
    siblings = (Path(f'/sys/devices/system/cpu/cpu{cpu}/topology/thread_siblings_list') for cpu in cpus)
    try:
        return len({path.read_text(encoding='ascii') for path in siblings})
    except OSError:
        return len(cpus)


def _session(content: bytes, path: str | Path, options: Any, providers: Sequence[str], device: str) -> Any:
    """A session. If the provider of a GPU cannot start, ``auto`` falls back to the CPU; ConfigError for ``cuda``."""
    try:
        return onnxruntime.InferenceSession(content, options, providers=list(providers))
    except Exception as error:  # its exceptions have no common base class
        if CUDA_PROVIDER not in providers:
            raise _cannot_run(path, error) from error
        # If the CPU cannot start it either, the file is the cause.
        session = _session(content, path, options, (CPU_PROVIDER,), device)
        if device == 'cuda':
            raise cuda_unavailable(f'ONNX Runtime could not start {CUDA_PROVIDER} ({first_line(error)})') from error
        return session


def _cannot_run(path: str | Path, error: Exception) -> ModelError:
    return ModelError(f'{path}: ONNX Runtime cannot run it ({first_line(error)})')
