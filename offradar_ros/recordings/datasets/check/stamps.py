"""Rate, gaps and order of stamps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.positions.rules import YEAR_2000_NS
from offradar_ros.recordings.datasets.check.findings import Finding, counted, note, ok, problem
from offradar_ros.recordings.datasets.coverage import span_ns

# A scan that comes later than this many typical periods after the one before leaves a gap.
_GAP_PERIODS = 1.5
# No radar turns again within this part of a period: such a scan is there twice, under two stamps.
_TWIN_PERIODS = 0.25


def check_stamps(stamps_ns: NDArray[np.int64], names: Sequence[str] = ()) -> Iterator[Finding]:
    """Findings about (N,) int64 scan stamps in the order of the recording; `names` are the scans', if they have any."""
    count = len(stamps_ns)
    if count < 2:
        yield note('a single scan: no rate')
        return
    steps = np.diff(stamps_ns)
    forward = steps[steps > 0]
    first_ns, last_ns = span_ns(stamps_ns)
    if len(forward):
        period_s = float(np.percentile(forward, 50, method='lower')) / 1e9
        yield ok(f'{(last_ns - first_ns) / 1e9:.1f} s at {1 / period_s:.2f} scans a second')
        late = np.flatnonzero(steps > _GAP_PERIODS * period_s * 1e9)
        if len(late):
            worst = int(late[np.argmax(steps[late])])
            yield problem(
                f'{counted(len(late), "gap")} between scans, the longest {steps[worst] / 1e9:.2f} s after scan {worst} '
                f'(stamp {stamps_ns[worst]} ns)'
            )
        twins = np.flatnonzero((steps > 0) & (steps < _TWIN_PERIODS * period_s * 1e9))
        if len(twins):
            first = int(twins[0])
            which = names[first + 1] if names else f'stamp {stamps_ns[first + 1]} ns'
            yield problem(
                f'{counted(len(twins), "scan")} less than a quarter of a period after the one before, which no radar '
                f'measures: there twice? First {which}, {steps[first] / 1e6:.3f} ms after'
                + (f' {names[first]}' if names else f' stamp {stamps_ns[first]} ns')
            )
    if first_ns < YEAR_2000_NS:
        yield note('stamps count from a start, not from 1970: simulated time, or a clock that was never set')
    repeated = np.flatnonzero(steps == 0)
    if len(repeated):
        yield problem(
            f'{counted(len(repeated), "repeated stamp")}, first {stamps_ns[repeated[0]]} ns: '
            'only the first scan of each is used'
        )
    back = np.flatnonzero(steps < 0)
    if len(back):
        yield problem(f'stamps go backwards {counted(len(back), "time")}, first after scan {back[0]}')
