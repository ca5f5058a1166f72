"""Every scan is decoded: which cannot be read, differ from the others or contradict their stamp."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.encoder_counts import LARGEST_SHARE_MENDED, WAY_OUT
from offradar_ros.recordings.datasets.check.findings import Finding, counted, first_few, note, ok, problem
from offradar_ros.recordings.datasets.check.scan_faults import ScanFaults
from offradar_ros.recordings.datasets.sequence import RecordedSequence
from offradar_ros.types import PolarScan

# What is the same for every scan, so that one line names them all.
_REFUSALS = {
    'too_few_rows': 'too few azimuths whose power changes with range: the radar is blocked or saturated, or the '
    'rotation was cut off',
    'no_signal': 'no signal, every power value is zero, or the same',
    'no_metadata': 'rows without the metadata columns that this layout has: read another layout (--layout), or set '
    'radar.metadata_columns to 0 if all bytes are power, or radar.row_angles to equal if the first 11 are not',
    'invalid_stamp': 'a stamp before 1970, or from 2038 on, which no message can hold',
    'no_row_angles': f'encoder counts that are zero, constant or decreasing: {WAY_OUT}',
    'unsound_rows': f'over {LARGEST_SHARE_MENDED:.0%} of the encoder counts contradict the others: {WAY_OUT}',
    'uneven_rows': f'encoder counts that repeat or jump, a large part of the circle is empty: {WAY_OUT}',
    'turned_image': 'an image that is turned or mirrored, its metadata columns are not at the start of the rows: turn '
    'it back',
}
_NUMBER = re.compile(r'\d+')


def check_scans(
    sequence: RecordedSequence,
    sample: int = 0,
    progress: Callable[[int, int], None] | None = None,
    decoded: Callable[[PolarScan], None] | None = None,
) -> Iterator[Finding]:
    """Findings from decoding every scan, or `sample` of them, evenly spread, where that is not 0.

    `progress` gets (scan, scans) before each one, from 1; `decoded` gets each scan that can be read.
    """
    indices = list(range(len(sequence)))
    if 0 < sample < len(sequence):
        indices = [int(i) for i in np.linspace(0, len(sequence) - 1, sample).round()]
        yield note(f'{len(indices)} of {len(sequence)} scans decoded')
    faults = ScanFaults()
    unreadable: dict[str, list[str]] = {}
    anchors: Counter[str] = Counter()
    for done, index in enumerate(indices, start=1):
        if progress is not None:
            progress(done, len(indices))
        file = sequence.files[index].name
        try:
            scan = sequence.scan(index)
        except DataError as error:
            unreadable.setdefault(_NUMBER.sub('#', str(error).replace(file, '')), [str(error)]).append(file)
            continue
        except RefusedInput as refusal:
            reason = str(refusal).removeprefix(f'{sequence.files[index]}: ')
            faults.add_fault(_REFUSALS.get(refusal.cause, reason), file)
            continue
        if decoded is not None:
            decoded(scan)
        faults.add(scan, file)
        if scan.azimuth_stamps_ns is not None and 'stamp_unusable' not in scan.row_faults:
            anchors[_anchor(scan)] += 1
    for first, *others in unreadable.values():
        more = f' (and {counted(len(others) - 1, "scan")} like it: {first_few(others[1:])})' if len(others) > 1 else ''
        yield problem(first + more)
    yield from faults.findings()
    for anchor, count in anchors.most_common():
        if anchor:
            yield ok(f'stamp of the scan is that of its {anchor} row: {counted(count, "scan")}')


def _anchor(scan: PolarScan) -> str:
    """The row whose stamp is the scan's stamp; empty if there is none."""
    stamps = scan.azimuth_stamps_ns
    if stamps is None or scan.stamp_ns not in stamps:
        return ''
    row = int(np.flatnonzero(stamps == scan.stamp_ns)[0])
    return {0: 'first', len(stamps) - 1: 'last', len(stamps) // 2: 'middle'}.get(row, f'{row}th')
