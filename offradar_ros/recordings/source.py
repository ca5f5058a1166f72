"""A data-set folder or a bag: opening either as a sequence."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.storage import METADATA, holds_storage, is_storage
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.datasets.registry import LAYOUTS, open_sequence, recognised
from offradar_ros.sequence import RadarSequence

LAYOUT_HELP = f'Layout of the folder: auto recognises it; else {", ".join(LAYOUTS)}.'
_MOST_NAMED = 3


def open_source(
    path: Path, layout: str = 'auto', radar: RadarConfig | None = None, topics: ChosenTopics | None = None
) -> RadarSequence:
    """The scans at `path`, a bag or a data-set folder of `layout`, as `radar` says; DataError for anything else.

    `topics` chooses among those of a bag.
    """
    require_recording(path, layout)
    require_bag(path, topics)
    if not is_bag(path):
        return open_sequence(path, layout, radar)
    try:
        # Here, because machines that train on folders and on simulated scans need no rosbags.
        from offradar_ros.recordings.bags.sequence import BagSequence  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise DataError(
            f"{path}: a bag is read with the Python package rosbags: pip install 'rosbags>=0.11' ({error})"
        ) from error
    return BagSequence(path, radar, topics)


def is_bag(path: str | Path) -> bool:
    """Whether `path` is a recording of ROS, be it unfinished or of ROS 1: reading it reports what is wrong."""
    path = Path(path)
    if not path.is_dir():
        return path.exists() and is_storage(path)
    if (path / METADATA).exists() or any(not file.name.startswith('.') for file in path.glob('*.mcap')):
        return True
    # Data sets may have such files beside their scans.
    return holds_storage(path) and recognised(path) is None


def require_bag(path: Path, topics: ChosenTopics | None) -> None:
    """DataError where topics are chosen of what is no bag."""
    if topics is not None and any(topics) and not is_bag(path):
        option = '--topic' if topics.scans else '--positions'
        raise DataError(f'{path}: is no bag, which {option} is for')


def is_recording(path: Path, layout: str = 'auto') -> bool:
    """Whether `path` is a bag or a data-set folder; OSError where it may not be read."""
    if is_bag(path):
        return True
    if layout == 'auto':
        return recognised(path) is not None
    return layout in LAYOUTS and LAYOUTS[layout].locate(path.resolve()) is not None


def require_recording(path: Path, layout: str) -> None:
    """DataError where `path` is missing, or is a folder of recordings, some of which the error names."""
    if not path.exists():
        raise DataError(f'{path}: no such folder')
    inside = recordings_in(path, layout)
    if inside:
        others = f' (or one of {len(inside) - _MOST_NAMED} others)' if len(inside) > _MOST_NAMED else ''
        raise DataError(
            f'{path}: no radar scans recognised: did you mean {" or ".join(map(str, inside[:_MOST_NAMED]))}?{others}'
        )


def recordings_in(path: Path, layout: str) -> list[Path]:
    """The data-set folders and bags in a folder, by name; empty where `path` is no folder, or a recording itself.

    Folders in it that may not be read are ignored.
    """
    try:
        if not path.is_dir() or is_recording(path, layout):
            return []
        return [folder for folder in folders_in(path) if _is_readable_recording(folder, layout)]
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from error


def folders_in(path: Path) -> list[Path]:
    """The folders in a folder, by name, without hidden ones."""
    return [found for found in sorted(path.iterdir()) if found.is_dir() and not found.name.startswith('.')]


def _is_readable_recording(path: Path, layout: str) -> bool:
    try:
        return is_recording(path, layout)
    except OSError:
        return False
