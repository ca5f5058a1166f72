"""The figures of a run as lines of JSON, and as a picture."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from offradar_ros.bounded_input import parse_json, read_bounded
from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.errors import DataError
from offradar_ros.whole_file import write_whole_file

_LARGEST = 256 * 1024**2


class RunLog:
    """A file with one record per line, each with its ``step``."""

    def __init__(self, path: Path, first_step: int) -> None:
        """Existing records after `first_step` are dropped: they were written after the checkpoint that is resumed."""
        self._path = path
        kept = [record for record in read_log(path) if record['step'] <= first_step] if first_step else []
        with self._named_errors():
            write_whole_file(self._path, ''.join(_line(record) for record in kept).encode())

    def add(self, step: int, figures: Mapping[str, float]) -> None:
        """Append a record; it is written when this returns."""
        with self._named_errors(), self._path.open('a', encoding='utf-8') as file:
            file.write(_line({'step': step, **figures}))

    @contextlib.contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DataError(f'{self._path}: cannot be written ({error.strerror})') from error


def _line(record: Mapping[str, Any]) -> str:
    # JSON has no NaN.
    known = {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in record.items()}
    return json.dumps(known) + '\n'


def read_log(path: Path) -> list[dict[str, Any]]:
    """All records, without an incomplete last line. DataError for a file that is not a log."""
    if not path.is_file():
        return []
    try:
        # A whole line is one that ends; split at line feeds alone.
        lines = read_bounded(path, _LARGEST).decode().split('\n')[:-1]
        return [parse_json(line) for line in lines]
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from error
    except ValueError as error:
        raise DataError(f'{path}: not a log of a training run ({error})') from error


def draw_curves(folder: Path) -> None:
    """Draw ``curves.png`` from ``log.jsonl`` and ``validation.jsonl``; does nothing without matplotlib."""
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError:
        return
    figure = Figure(figsize=(10, 4), layout='constrained')
    for axes, name in zip(figure.subplots(1, 2), ('log', 'validation'), strict=True):
        records = read_log(folder / f'{name}.jsonl')
        keys = dict.fromkeys(key for record in records for key in record)
        for key in keys:
            if key in ('step', 'learning_rate', 'gradient_norm', 'images_per_s'):
                continue
            points = [(record['step'], record[key]) for record in records if record.get(key) is not None]
            axes.plot(*zip(*points, strict=True), label=key, linewidth=1) if points else None
        axes.set_xlabel('step')
        axes.set_title({'log': 'losses', 'validation': 'validation'}[name])
        if records:
            axes.legend(fontsize='small')
        axes.grid(alpha=0.3)
    save_picture(figure, folder / 'curves.png', dpi=120)
