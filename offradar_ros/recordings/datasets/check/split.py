"""Which sequences of a split are present, and how many of their scans it uses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from offradar_ros.recordings.datasets.check.findings import Finding, note, ok, problem
from offradar_ros.recordings.datasets.check.scan_positions import ScanPositions
from offradar_ros.recordings.datasets.splits import Split


def check_split(split: Split, sequences: Sequence[ScanPositions]) -> Iterator[Finding]:
    """Findings about the sequences of a data set, as a split divides them."""
    found = {sequence.name: sequence for sequence in sequences}
    for kind, names in (('test', split.test), ('training', split.train)):
        missing = [name for name in names if name not in found]
        if missing:
            yield problem(f'{len(missing)} of {len(names)} {kind} sequences are missing: {", ".join(missing)}')
        else:
            yield ok(f'all {len(names)} {kind} sequences are there')
    extra = [name for name in found if name not in (*split.test, *split.train)]
    if extra:
        yield note(f'not of the split: {", ".join(extra)}')
    for name in (*split.test, *split.train):
        if name in found:
            yield _scans(split, found[name])


def _scans(split: Split, sequence: ScanPositions) -> Finding:
    name, count = sequence.name, len(sequence.positions)
    if split.region and not sequence.geodetic:
        return problem(f'{name}: expected latitudes and longitudes, as the split has a test region')
    if name in split.test:
        chosen, what = split.tested(sequence.positions), 'tested'
    else:
        chosen, what = split.trainable(sequence.positions), 'usable for training'
    lost = int(np.count_nonzero(~sequence.known))
    usable = int(np.count_nonzero(chosen))
    reasons = []
    if split.region:
        where = 'outside the region' if name in split.test else f'within {split.buffer_m:g} m of the test region'
        reasons.append(f'{count - lost - usable} {where}')
    if lost:
        reasons.append(f'{lost} without a position')
    text = f'{name}: {usable} of {count} scans {what}' + (f' ({", ".join(reasons)})' if reasons else '')
    return ok(text) if usable else problem(text)
