"""Whether the file of a map can still be written."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from offradar_ros.entry_point import explain
from offradar_ros.ros.diagnostics import Trouble

LOW_BYTES = 200 * 1024**2
FULL_BYTES = 20 * 1024**2


def disk_trouble(path: Path) -> Trouble | None:
    """Why a map file cannot be written, or soon cannot; None if it can."""
    try:
        if not path.exists():
            return Trouble(
                'map_file_gone', f'{path}: the map file was removed or renamed: put it back, or end the session', True
            )
        for each in (path, path.absolute().parent):
            if not os.access(each, os.W_OK):
                return Trouble(
                    'map_not_writable', f'{each}: cannot be written: change its permissions, or use another map', True
                )
        free = shutil.disk_usage(path.absolute().parent).free
    except OSError as error:
        return Trouble('map_not_writable', explain(error), is_error=True)
    if free >= LOW_BYTES:
        return None
    text = f'{path}: only {free / 1024**2:.0f} MiB are left on its disk: free some space'
    return Trouble('disk_nearly_full', text, is_error=free < FULL_BYTES)
