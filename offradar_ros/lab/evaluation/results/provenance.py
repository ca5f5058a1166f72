"""The machine and the software versions that figures were measured with."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import os
import platform
from collections.abc import Sequence
from pathlib import Path

from offradar_ros import __version__

PACKAGES = ('numpy', 'opencv-python-headless', 'torch', 'onnxruntime', 'safetensors')
"""Packages that figures depend on."""


@dataclasses.dataclass(frozen=True)
class Machine:
    """Name of the processor, and number of cores that the process may use."""

    processor: str
    cores: int


def this_machine() -> Machine:
    """The machine of this process."""
    return Machine(processor(), len(os.sched_getaffinity(0)))


def processor() -> str:
    """Name of the processor, from Linux."""
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()


def versions(packages: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Versions of the project, of Python and of those `packages` that are installed."""
    found = {'offradar_ros': __version__, 'python': platform.python_version()}
    for package in packages:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
