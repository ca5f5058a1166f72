"""Which scans of a drive are kept when one every so many metres is wanted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def one_a_cell(driven_m: NDArray[np.float64], spacing_m: float) -> NDArray[np.intp]:
    """Indices of the first scan in each stretch of `spacing_m` of the way driven, (N,) metres, never decreasing.

    The mean spacing is `spacing_m` whatever the way between two scans, as long as that is shorter. To keep a scan
    whenever the last kept one is `spacing_m` away would give 6 m instead of 5 m where scans are 2 m apart.
    """
    cells = np.floor(driven_m / spacing_m + 1e-9).astype(np.int64)
    return np.flatnonzero(np.diff(cells, prepend=cells[:1] - 1) > 0)
