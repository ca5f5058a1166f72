"""Weights of a learned encoder: a safetensors file with a header. Needs no torch."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
from numpy.typing import NDArray
from safetensors.numpy import load, save

from offradar_ros.encoders.fingerprint import fingerprint
from offradar_ros.encoders.model_files import first_line, write_atomically
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.safetensors_file import BLANK, read_safetensors, with_digest
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ModelError


def save_weights(
    path: str | Path,
    config: NetworkConfig,
    tensors: Mapping[str, NDArray[Any]],
    description: str = '',
    half: bool = False,
) -> WeightsHeader:
    """Write weights atomically; returns their header.

    With `half`, float32 matrices and kernels are rounded to float16 (vectors, such as biases and batch statistics, keep
    their precision); the fingerprint is of the rounded weights. ModelError for a value beyond the range of float16.
    """
    if half:
        tensors = {name: _rounded(name, tensor, path) for name, tensor in tensors.items()}
    digest = fingerprint(config.method, dataclasses.asdict(config), _as_loaded(tensors))
    header = WeightsHeader(config, digest, description=description, stored='float16' if half else 'float32')
    contiguous = {name: np.ascontiguousarray(tensor).reshape(tensor.shape) for name, tensor in tensors.items()}
    write_atomically(path, with_digest(save(contiguous, metadata={**header.to_metadata(), **BLANK})))
    return header


def read_header(path: str | Path) -> WeightsHeader:
    """Header of a weights file without its tensors; ModelError for a missing, damaged or other file."""
    return WeightsHeader.from_metadata(read_safetensors(path)[1], path)


def load_weights(path: str | Path) -> tuple[WeightsHeader, dict[str, NDArray[Any]]]:
    """Header and tensors by name; half-precision ones are converted to float32.

    ModelError as `read_header`, and if the fingerprint of the tensors is not that in the header.
    """
    content, metadata = read_safetensors(path)
    header = WeightsHeader.from_metadata(metadata, path)
    try:
        tensors = _as_loaded(load(content))
    except (safetensors.SafetensorError, TypeError, KeyError, ValueError) as error:
        raise ModelError(f'{path}: its tensors cannot be read ({first_line(error)})') from error
    found = fingerprint(header.config.method, dataclasses.asdict(header.config), tensors)
    if found != header.fingerprint:
        raise ModelError(
            f'{path}: damaged or altered: expected fingerprint {header.fingerprint}, but its tensors give {found}'
        )
    return header, tensors


def _as_loaded(tensors: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    return {
        name: tensor.astype(np.float32) if tensor.dtype == np.float16 else tensor for name, tensor in tensors.items()
    }


def _rounded(name: str, tensor: NDArray[Any], path: str | Path) -> NDArray[Any]:
    if tensor.dtype != np.float32 or tensor.ndim < 2:
        return tensor
    with np.errstate(over='ignore'):
        half = tensor.astype(np.float16)
    if not np.array_equal(np.isfinite(half), np.isfinite(tensor)):
        raise ModelError(f'{path}: tensor {name} holds numbers beyond half precision (±65504)')
    return half
