"""A Python that does not find some packages, though they are installed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

_WITHOUT = """
import sys

class Without:
    def __init__(self, finder):
        self._finder = finder

    def find_spec(self, name, path=None, target=None):
        return None if name.partition('.')[0] in {absent} else self._finder.find_spec(name, path, target)

    def __getattr__(self, name):
        return getattr(self._finder, name)

sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
"""


def environment_without(packages: Sequence[str], folder: Path) -> dict[str, str]:
    """Variables of the environment for a process that finds none of `packages`; `folder` is made for it."""
    folder.mkdir()
    (folder / 'sitecustomize.py').write_text(_WITHOUT.format(absent=tuple(packages)))
    return {'PYTHONPATH': os.pathsep.join([str(folder), *filter(None, [os.environ.get('PYTHONPATH')])])}
