"""Weights that are part of the package, by name."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.errors import ConfigError

FOLDER = Path(__file__).resolve().parent.parent / 'weights'
"""Holds NAME.onnx, NAME.safetensors or both; both are one model, with one fingerprint."""

SUFFIXES = ('.onnx', '.safetensors')


def pretrained_names() -> tuple[str, ...]:
    """Sorted names of the weights in the package."""
    return tuple(sorted({path.stem for path in FOLDER.glob('*') if path.suffix in SUFFIXES}))


def find_weights(weights: str, suffixes: tuple[str, ...], setting: str = 'parameter encoder.weights') -> Path:
    """The weights file for a setting, which is a path or the name of weights in the package.

    A name with several files gives the file with the first of `suffixes`. ConfigError, which names the setting, for an
    empty one and for a name without a file of these suffixes.
    """
    path = Path(weights)
    if path.suffix in SUFFIXES:
        return path
    for suffix in suffixes:
        file = FOLDER / f'{weights}{suffix}'
        if path.name == weights and file.is_file():
            return file
    endings = ' or '.join(suffixes)
    raise ConfigError(
        f'{setting}: expected a {endings} file or the name of weights in offradar_ros '
        f'({", ".join(pretrained_names()) or "none in this build"}), got {weights!r}'
    )
