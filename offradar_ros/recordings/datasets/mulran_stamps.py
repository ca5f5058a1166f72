"""Stamps of MulRan's bare polar images, which carry none themselves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.folders import lines_of
from offradar_ros.recordings.datasets.listed_scans import listing_differences
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns, stamp_of_name
from offradar_ros.recordings.datasets.stamped_png import ASSUMED_PERIOD_NS, first_row_stamp

_RADAR_NAMES = ('radar', 'navtech')


def polar_stamps(files: Sequence[Path], root: Path, radar: RadarConfig) -> tuple[list[int], list[str]]:
    """A stamp for each file, and what had to be assumed.

    In this order: the file's name; its place in navtech_top_stamp.csv or data_stamp.csv (its name if that is a number,
    else its order); the first row of the image of the same name in polar_oxford_form; 0.25 s a scan from zero.
    """
    named = [stamp_of_name(file) for file in files]
    stamps = [stamp for stamp in named if stamp is not None]
    if len(stamps) == len(files):
        return stamps, []
    places = [int(f.stem) if f.stem.isascii() and f.stem.isdigit() else k for k, f in enumerate(files)]
    _, listed = _listed_stamps(root)
    if listed and max(places) < len(listed):
        return [listed[place] for place in places], []
    siblings = [first_row_stamp(file.parent.parent / 'polar_oxford_form' / file.name, radar) for file in files]
    stamps = [stamp for stamp in siblings if stamp is not None]
    if len(stamps) == len(files):
        return stamps, []
    warning = (
        f'{files[0].parent}: files are not named by stamp, and neither navtech_top_stamp.csv nor polar_oxford_form has '
        'their stamps: assumed 0.25 s a scan from zero, so positions cannot be matched'
    )
    return [place * ASSUMED_PERIOD_NS for place in places], [warning]


def stamp_list_differences(files: Sequence[Path], root: Path) -> list[str]:
    """How files that are named by stamp and the list of the radar's stamps disagree, one line each.

    Empty where they have no stamp in common: then it is the list of another recording.
    """
    try:
        listing, listed = _listed_stamps(root)
    except DataError as error:
        return [str(error)]
    if not {stamp_of_name(file) for file in files} & set(listed):
        return []
    return listing_differences(listing, listed, files, unit_ns=1)


def _listed_stamps(root: Path) -> tuple[Path, list[int]]:
    """The first list that exists, and the radar's stamps in it. A line holds a stamp, or a stamp and a sensor."""
    for folder in (root / 'sensor_data', root):
        for name in ('navtech_top_stamp.csv', 'data_stamp.csv'):
            if (folder / name).is_file():
                stamps = _stamps_in(folder / name, every=name.startswith('navtech'))
                if stamps:
                    return folder / name, stamps
    return root, []


def _stamps_in(path: Path, *, every: bool) -> list[int]:
    stamps = []
    for number, line in enumerate(lines_of(path), start=1):
        stamp, _, sensor = line.partition(',')
        if not stamp.strip() or not (every or any(name in sensor.lower() for name in _RADAR_NAMES)):
            continue
        try:
            stamps.append(parse_stamp_ns(stamp))
        except ValueError as error:
            raise DataError(f'{path}, line {number}: expected a stamp in ns: {error}') from None
    return stamps
