"""Files of ``params/`` by name, for a package in its sources, in a colcon workspace or in a pip environment."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.errors import ConfigError


def shipped_file(folder: str, text: str | Path) -> Path:
    """The file with the path `text`, or with the name `text` in ``params/FOLDER``.

    A name has neither a slash nor ``.yaml``. ConfigError for an unknown name lists the known ones.
    """
    if os.sep in str(text) or str(text).endswith('.yaml'):
        return Path(text)
    found = _by_name(folder)
    if str(text) not in found:
        names = ', '.join(sorted(found)) or 'none are installed'
        raise ConfigError(f'{text}: expected a YAML file or one of the {folder} of this package: {names}')
    return found[str(text)]


def shipped_files(folder: str) -> list[Path]:
    """Every YAML file of ``params/FOLDER``, sorted by name."""
    return [path for _, path in sorted(_by_name(folder).items())]


def _by_name(folder: str) -> dict[str, Path]:
    return {path.stem: path for place in _places() for path in sorted((place / folder).glob('*.yaml'))}


def installed_file(name: str) -> Path | None:
    """``params/NAME``, or None if it is not installed, for example after ``pip install --target``."""
    found = [place / name for place in _places() if (place / name).is_file()]
    return found[-1] if found else None


def _places() -> Iterator[Path]:
    """Folders where ``params`` may be; of several files with one name the last is used."""
    share = Path('share', 'offradar_ros', 'params')
    for prefix in (sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)[::-1]):
        if prefix:
            yield Path(prefix) / share
    yield Path(__file__).resolve().parent.parent / 'params'
