"""Weights that come with the package, by name."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.errors import ConfigError

FOLDER = Path(__file__).resolve().parent.parent / 'weights'
"""Holds NAME.onnx, NAME.safetensors or both: two files of one model, with one fingerprint."""

SUFFIXES = ('.onnx', '.safetensors')


def pretrained_names() -> tuple[str, ...]:
    """Names of the weights that come with the package, sorted."""
    return tuple(sorted({path.stem for path in FOLDER.glob('*') if path.suffix in SUFFIXES}))


def find_weights(weights: str, suffixes: tuple[str, ...]) -> Path:
    """The file that the parameter `encoder.weights` means: a path as it is, a name as our own file of that name.

    Of several files of a name that of the first of `suffixes` is taken. ConfigError for an empty parameter and for a
    name that we have no such file of.
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
        f'parameter encoder.weights: expected a {endings} file or the name of weights that come with offradar_ros '
        f'({", ".join(pretrained_names()) or "none in this build"}), got {weights!r}'
    )
