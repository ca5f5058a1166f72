"""nav2 maps: a YAML file that names an image, and which of its cells are occupied.

Format: https://docs.ros.org/en/jazzy/p/nav2_map_server (`image`, `resolution`, `origin` x, y, yaw of the lower left
corner, `negate`, `occupied_thresh`, `free_thresh`, `mode` trinary, scale or raw). A cell of gray value g is occupied
where p = (255 − g) / 255 (p = g / 255 if `negate`) exceeds `occupied_thresh`; in `raw` mode g itself is the occupancy
in percent, and values over 100 are unknown.
"""

from __future__ import annotations

import dataclasses
import math
import reprlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from offradar_ros.bounded_input import parse_yaml, read_bounded, read_text
from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.image_size import image_size

_SHORT = reprlib.Repr()
_MODES = ('trinary', 'scale', 'raw')
_MAX_PIXELS = 2**27
_MAX_BYTES = 4 * _MAX_PIXELS + 2**20


@dataclasses.dataclass(frozen=True, eq=False)
class MapImage:
    """The occupied cells of a map and where they lie.

    Attributes:
        occupied: (H, W) bool, row 0 is the top of the image.
        resolution_m: side of a cell.
        origin: x, y in metres and yaw in radians of the lower left corner of the lower left cell.
    """

    occupied: NDArray[np.bool_]
    resolution_m: float
    origin: tuple[float, float, float]

    def to_world(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) column and row of pixels → (N, 2) metres of their centres in the frame of the map."""
        x_m = (pixels[:, 0] + 0.5) * self.resolution_m
        y_m = (len(self.occupied) - pixels[:, 1] - 0.5) * self.resolution_m
        x, y, yaw = self.origin
        cosine, sine = math.cos(yaw), math.sin(yaw)
        return np.column_stack([x + cosine * x_m - sine * y_m, y + sine * x_m + cosine * y_m])


def read_map_image(path: str | Path) -> MapImage:
    """The map of a YAML file; DataError, with the file and the key, for a value that is not allowed."""
    path = Path(path)
    values = _read_yaml(path)
    resolution = _number(path, values, 'resolution')
    if not 1e-3 <= resolution <= 100.0:
        raise DataError(f'{path}: resolution: expected 0.001 to 100 metres per cell, got {resolution:g}')
    origin = values.get('origin')
    if not isinstance(origin, list) or len(origin) < 3 or not all(_finite(v) for v in origin[:3]):
        raise DataError(f'{path}: origin: expected three numbers, x, y and yaw, got {_SHORT.repr(origin)}')
    mode = values.get('mode', 'trinary')
    if mode not in _MODES:
        raise DataError(f'{path}: mode: expected {", ".join(_MODES)}, got {_SHORT.repr(mode)}')
    negate = values.get('negate', 0)
    if negate not in (0, 1):
        raise DataError(f'{path}: negate: expected 0 or 1, got {_SHORT.repr(negate)}')
    threshold = _number(path, values, 'occupied_thresh', 0.65)
    if not 0.0 <= threshold <= 1.0:
        raise DataError(f'{path}: occupied_thresh: expected 0 to 1, got {threshold:g}')
    gray, opaque = _read_pixels(path, values.get('image'))
    occupied = _occupied(gray, opaque, mode, bool(negate), threshold)
    return MapImage(occupied, resolution, (float(origin[0]), float(origin[1]), float(origin[2])))


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        values = parse_yaml(read_text(path))
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None
    except (ValueError, yaml.YAMLError) as error:
        raise DataError(f'{path}: not a YAML file ({str(error).splitlines()[0]})') from None
    if not isinstance(values, dict) or 'image' not in values:
        raise DataError(f'{path}: expected a nav2 map with image, resolution and origin')
    return values


def _finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


def _number(path: Path, values: dict[str, Any], name: str, default: float | None = None) -> float:
    value: Any = values.get(name, default)
    if not _finite(value):
        raise DataError(f'{path}: {name}: expected a number, got {_SHORT.repr(value)}')
    return float(value)


def _read_pixels(path: Path, name: Any) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(H, W) gray values 0 to 255, and (H, W) whether each pixel is opaque (alpha above 127)."""
    if not isinstance(name, str) or not name or '\0' in name:
        raise DataError(f'{path}: image: expected the name of a file, got {_SHORT.repr(name)}')
    file = path.parent / name
    try:
        data = read_bounded(file, _MAX_BYTES)
        width, height = image_size(data)
    except OSError as error:
        raise DataError(f'{file}: cannot be read ({error.strerror}); {path} names it') from None
    except ValueError as error:
        raise DataError(
            f'{file}: expected an image of 8 bits a channel (PNG, PGM, BMP), {error}; {path} names it'
        ) from None
    if width * height > _MAX_PIXELS:
        raise DataError(f'{file}: expected up to {_MAX_PIXELS} pixels, got {width} × {height}')
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.dtype != np.uint8 or image.shape[:2] != (height, width):
        raise DataError(f'{file}: expected an image of 8 bits a channel (PNG, PGM, BMP); {path} names it')
    channels = np.atleast_3d(image)
    opaque = channels[:, :, -1] > 127 if channels.shape[2] in (2, 4) else np.ones(image.shape[:2], np.bool_)
    colours = channels[:, :, : 3 if channels.shape[2] >= 3 else 1]
    return np.asarray(colours.mean(axis=2)), opaque


def _occupied(
    gray: NDArray[np.float64], opaque: NDArray[np.bool_], mode: str, negate: bool, threshold: float
) -> NDArray[np.bool_]:
    if mode == 'raw':
        return np.asarray((gray <= 100.0) & (gray >= 100.0 * threshold))
    share = gray / 255.0 if negate else (255.0 - gray) / 255.0
    return np.asarray((share > threshold) & opaque)
