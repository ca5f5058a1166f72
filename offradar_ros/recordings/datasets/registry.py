"""The layouts of data sets, and opening a folder in any of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets import boreas, mulran, mulran_ray, oxford, radiate
from offradar_ros.recordings.datasets.sequence import RecordedSequence


class Layout(NamedTuple):
    """How a data set lies on disk: what it is recognised by, where its scans are, and how to open them."""

    looks_for: str
    locate: Callable[[Path], Path | None]
    open: Callable[[Path, RadarConfig], RecordedSequence]


# In the order in which they are tried: the first that fits wins.
LAYOUTS: dict[str, Layout] = {
    'radiate': Layout(radiate.LOOKS_FOR, radiate.locate, radiate.open_radiate),
    'mulran': Layout(mulran.LOOKS_FOR_OXFORD_FORM, mulran.locate_oxford_form, mulran.open_oxford_form),
    'mulran_polar': Layout(mulran.LOOKS_FOR_POLAR, mulran.locate_polar, mulran.open_polar),
    'mulran_ray': Layout(mulran_ray.LOOKS_FOR, mulran_ray.locate, mulran_ray.open_ray),
    'oxford': Layout(oxford.LOOKS_FOR, oxford.locate, oxford.open_oxford),
    'boreas': Layout(boreas.LOOKS_FOR, boreas.locate, boreas.open_boreas),
}


def open_sequence(path: str | Path, layout: str = 'auto', radar: RadarConfig | None = None) -> RecordedSequence:
    """The sequence in a data set's folder (or its folder of scans), recognised by content or opened as `layout`.

    DataError says what was looked for where nothing fits.
    """
    folder = Path(path).resolve()
    if not folder.is_dir():
        raise DataError(f'{path}: ' + ('not a folder' if folder.exists() else 'no such folder'))
    if layout != 'auto' and layout not in LAYOUTS:
        raise DataError(f'layout {layout!r} is unknown: expected auto, {", ".join(LAYOUTS)}')
    name = recognised(folder) if layout == 'auto' else layout
    scans = LAYOUTS[name].locate(folder) if name else None
    if name is None or scans is None:
        looked_for = f'the layouts {", ".join(LAYOUTS)}' if name is None else LAYOUTS[name].looks_for
        raise DataError(f'{path}: no radar scans recognised: looked for {looked_for}')
    return LAYOUTS[name].open(scans, radar or RadarConfig())


def recognised(folder: Path) -> str | None:
    """Name of the first layout that fits the folder."""
    return next((name for name, layout in LAYOUTS.items() if layout.locate(folder.resolve()) is not None), None)
