"""Files of ``params/`` by name, wherever the package is: in its sources, a colcon workspace or a pip environment."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.errors import ConfigError


def shipped_file(folder: str, text: str | Path) -> Path:
    """The file that `text` is the path of, or the name of in ``params/FOLDER``; ConfigError lists the names there are.

    A name has neither a slash nor ``.yaml``.
    """
    if os.sep in str(text) or str(text).endswith('.yaml'):
        return Path(text)
    found = {path.stem: path for place in _places() for path in sorted((place / folder).glob('*.yaml'))}
    if str(text) not in found:
        names = ', '.join(sorted(found)) or 'none are installed'
        raise ConfigError(f'{text}: expected a YAML file or one of the {folder} that come with us: {names}')
    return found[str(text)]


def installed_file(name: str) -> Path | None:
    """``params/NAME``, or None where it is not installed, as by ``pip install --target``."""
    found = [place / name for place in _places() if (place / name).is_file()]
    return found[-1] if found else None


def _places() -> Iterator[Path]:
    """Where ``params`` may be; of files of one name the last counts."""
    share = Path('share', 'offradar_ros', 'params')
    for prefix in (sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)[::-1]):
        if prefix:
            yield Path(prefix) / share
    yield Path(__file__).resolve().parent.parent / 'params'
