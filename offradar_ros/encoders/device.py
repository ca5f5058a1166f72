"""Where a learned encoder runs: what the parameter `encoder.device` asks for, and what there is. No runtime here."""

from __future__ import annotations

from collections.abc import Sequence

from offradar_ros.errors import ConfigError

CUDA_PROVIDER = 'CUDAExecutionProvider'
CPU_PROVIDER = 'CPUExecutionProvider'


def onnx_providers(device: str, available: Sequence[str]) -> tuple[str, ...]:
    """Providers for ONNX Runtime, preferred first, of those that it was built with.

    ``auto`` takes the GPU where there is a provider for it. ConfigError for ``cuda`` without one.
    """
    if device == 'cuda' and CUDA_PROVIDER not in available:
        raise no_cuda(f'ONNX Runtime offers {", ".join(available)}')
    wanted = (CPU_PROVIDER,) if device == 'cpu' else (CUDA_PROVIDER, CPU_PROVIDER)
    return tuple(provider for provider in wanted if provider in available)


def used_device(device: str, providers: Sequence[str]) -> str:
    """``cpu`` or ``cuda``, of the providers that a session took in the end; ConfigError for ``cuda`` without a GPU's.

    A provider whose libraries do not load is offered and then passed over in silence.
    """
    if device == 'cuda' and CUDA_PROVIDER not in providers:
        raise no_cuda(f'ONNX Runtime could not start {CUDA_PROVIDER} and took {", ".join(providers)}')
    return 'cuda' if CUDA_PROVIDER in providers else 'cpu'


def torch_device(device: str, version: str, has_cuda: bool) -> str:
    """``cpu`` or ``cuda``; ConfigError for ``cuda`` where this `version` of torch finds none."""
    if device == 'cuda' and not has_cuda:
        raise no_cuda(f'torch {version} finds no GPU')
    return 'cuda' if has_cuda and device != 'cpu' else 'cpu'


def no_cuda(found: str) -> ConfigError:
    """What to say where ``cuda`` was asked for and is not to be had."""
    return ConfigError(f"parameter encoder.device: expected a GPU, {found}, got 'cuda'")
