"""The device of a learned encoder: the parameter `encoder.device` against what is available. Needs no runtime."""

from __future__ import annotations

from collections.abc import Sequence

from offradar_ros.errors import ConfigError

CUDA_PROVIDER = 'CUDAExecutionProvider'
CPU_PROVIDER = 'CPUExecutionProvider'


def onnx_providers(device: str, available: Sequence[str]) -> tuple[str, ...]:
    """Providers for ONNX Runtime, preferred first, out of the available ones.

    ``auto`` takes the GPU if there is a provider for it. ConfigError for ``cuda`` without one.
    """
    if device == 'cuda' and CUDA_PROVIDER not in available:
        raise cuda_unavailable(f'ONNX Runtime offers {", ".join(available)}')
    wanted = (CPU_PROVIDER,) if device == 'cpu' else (CUDA_PROVIDER, CPU_PROVIDER)
    return tuple(provider for provider in wanted if provider in available)


def used_device(device: str, providers: Sequence[str]) -> str:
    """``cpu`` or ``cuda``, by the providers that a session uses; ConfigError if ``cuda`` is required but not used.

    ONNX Runtime lists a provider whose libraries are missing as available, and then does not use it, without an error.
    """
    if device == 'cuda' and CUDA_PROVIDER not in providers:
        raise cuda_unavailable(f'ONNX Runtime could not start {CUDA_PROVIDER} and took {", ".join(providers)}')
    return 'cuda' if CUDA_PROVIDER in providers else 'cpu'


def torch_device(device: str, version: str, has_cuda: bool) -> str:
    """``cpu`` or ``cuda``; ConfigError for ``cuda`` if this `version` of torch finds no GPU."""
    if device == 'cuda' and not has_cuda:
        raise cuda_unavailable(f'torch {version} finds no GPU')
    return 'cuda' if has_cuda and device != 'cpu' else 'cpu'


def cuda_unavailable(found: str) -> ConfigError:
    """The error for ``cuda`` on a machine without it; `found` says what there is."""
    return ConfigError(f"parameter encoder.device: expected a GPU, {found}, got 'cuda'")
