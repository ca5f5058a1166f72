"""Files of scans in a folder, wherever the data set's download or its tools put them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.navtech_rows import has_metadata
from offradar_ros.radar.png import read_gray_png
from offradar_ros.recordings.datasets.stamp_names import stamp_of_name
from offradar_ros.recordings.datasets.text_encoding import read_lines

_MAX_BYTES = 64 * 2**20
_MOST_READ = 5


def files_of(folder: Path, suffix: str) -> list[Path]:
    """Files of `folder` with this suffix, by name; empty where there is no such folder."""
    if not folder.is_dir():
        return []
    return sorted(f for f in folder.iterdir() if f.suffix.lower() == suffix and not f.name.startswith('.'))


def first_folder(root: Path, names: Sequence[str], suffix: str) -> Path | None:
    """The first of the subfolders `names` that holds files, or `root` itself if it has such a name and holds files."""
    for name in names:
        if files_of(root / name, suffix):
            return root / name
    if root.name in {Path(name).name for name in names} and files_of(root, suffix):
        return root
    return None


def sequence_folder(folder: Path, names: Sequence[str]) -> Path:
    """The sequence's folder: the first one, from `folder` upwards, whose name is not one of `names`."""
    while folder.name in names and folder.parent != folder:
        folder = folder.parent
    return folder


def lines_of(path: Path) -> list[str]:
    """Lines of a text file; DataError where it cannot be read."""
    try:
        return read_lines(path)
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None
    except ValueError:
        raise DataError(f'{path}: cannot be read (expected UTF-8 text)') from None


def named_by_stamp(files: Sequence[Path]) -> bool:
    """Whether most files are named by a stamp."""
    return 2 * sum(stamp_of_name(f) is not None for f in files) > len(files)


def have_metadata(files: Sequence[Path]) -> bool:
    """Whether one of the first readable PNG files has the 11 metadata columns."""
    return any(has_columns for _, has_columns in _first_readable(files))


def shape_of(files: Sequence[Path]) -> tuple[int, int] | None:
    """Rows and columns of the first readable PNG file."""
    return next((shape for shape, _ in _first_readable(files)), None)


def _first_readable(files: Sequence[Path]) -> Iterator[tuple[tuple[int, int], bool]]:
    for file in files[:_MOST_READ]:
        try:
            image = read_gray_png(file, _MAX_BYTES)
        except (DataError, RefusedInput):
            continue
        yield (int(image.shape[0]), int(image.shape[1])), has_metadata(image)
