"""Pictures of matplotlib as files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from offradar_ros.errors import ConfigError
from offradar_ros.whole_file import write_whole_file


def save_picture(figure: Any, path: str | Path, dpi: float | None = None) -> None:
    """Write a figure whole or not at all, in the format that the end of `path` names, else PNG.

    `dpi`: dots per inch; the figure's own without it. ConfigError where it cannot be written.
    """
    content = io.BytesIO()
    try:
        figure.savefig(content, format=Path(path).suffix[1:] or 'png', dpi=dpi or 'figure')
        write_whole_file(path, content.getvalue())
    except (OSError, ValueError) as error:
        raise ConfigError(f'{path}: the plot cannot be written ({error})') from error
