"""The folder of an evaluation, as read."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.methods import METHODS, OURS
from offradar_ros.lab.evaluation.protocol import ALL
from offradar_ros.lab.evaluation.results.arrays import MAPS_FILE, SCANS_FILE, read_arrays
from offradar_ros.lab.evaluation.results.file import RESULTS_FILE, read_results
from offradar_ros.lab.evaluation.results.results import Results, spacing_key


@dataclasses.dataclass(frozen=True, eq=False)
class Source:
    """The content of the folder of an evaluation.

    Attributes:
        folder: which also holds pictures.
        results: of the evaluation.
        rows: (R,) of type `SCANS`.
        maps: arrays ``before_K`` and ``after_K``, (P, 3) float64, as in `MapArrays`.
    """

    folder: Path
    results: Results
    rows: NDArray[Any]
    maps: dict[str, NDArray[np.float64]]

    @property
    def methods(self) -> list[str]:
        """Names of the methods that were measured, in the order of the paper's tables, ours last."""
        known = [name for name in METHODS if name != OURS and name in self.results.methods]
        others = [name for name in self.results.methods if name not in METHODS]
        return known + others + [OURS] * (OURS in self.results.methods)

    @property
    def main_method(self) -> str:
        """The method of the figures that show one method: ours if it was measured."""
        return self.methods[-1]

    @property
    def groups(self) -> list[str]:
        """Groups with results; if there are several, all of them together last."""
        groups = [name for name in self.results.groups if name != ALL]
        return groups + [ALL] * (len(groups) > 1)

    @property
    def spacings(self) -> list[str]:
        """Keys of the map spacings, that of the headline figures first."""
        return list(next(iter(self.results.groups.values())))

    def query_rows(self, group: str, spacing: str, method: str, maintained: bool = False) -> NDArray[Any]:
        """Rows of the queries with a positive, of all searches of a group."""
        wanted = (spacing, method, maintained)
        chosen = [
            number
            for number, search in enumerate(self.results.searches)
            if group in (ALL, search.pair.group)
            and (spacing_key(search.pair.spacing_m), search.pair.method, search.maintained) == wanted
        ]
        rows: NDArray[Any] = self.rows[np.isin(self.rows['pair'], chosen) & self.rows['positive']]
        return rows


def read_source(folder: str | Path) -> Source:
    """The folder of an evaluation; DataError names the file that is missing or damaged."""
    folder = Path(folder)
    results = read_results(folder / RESULTS_FILE)
    rows, maps = read_arrays(folder)
    if len(rows) != results.rows or len(maps) != 2 * len(results.maps):
        raise DataError(f'{folder}: {SCANS_FILE} and {MAPS_FILE} are not of the same evaluation as {RESULTS_FILE}')
    return Source(folder, results, rows, maps)
