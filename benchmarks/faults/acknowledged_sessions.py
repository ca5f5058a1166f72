"""Whether a map file holds every session whose end was acknowledged, and no session by half."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sample_signatures import packed_signature

from faults.result import DIFFERENT, LOST, SAME, Verdict
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import OffradarError
from offradar_ros.mapping.store import MapStore
from offradar_ros.types import Embedding, ScanKey

DIMENSION = 8
INFO = ModelInfo('ring_key', 'ab' * 32, DIMENSION, {})
ENDED, UNDONE = 'ended', 'undone'
EITHER = f'{ENDED} {UNDONE}'
"""While an undo has begun and is not answered."""


def known_embedding(stamp: int) -> Embedding:
    """The embedding of a scan, which follows from its stamp: so what a place holds can be checked."""
    return Embedding(stamp, mean_of(stamp), np.ones(DIMENSION, np.float32), INFO.fingerprint, signature_of(stamp))


def mean_of(stamp: int) -> NDArray[np.float32]:
    """Its mean."""
    return np.random.default_rng(stamp).standard_normal(DIMENSION).astype(np.float32)


def signature_of(stamp: int) -> bytes:
    """Its signature; that of every eighth scan is as long as any can be."""
    return packed_signature(stamp, 200, 80) if stamp % 8 == 0 else packed_signature(stamp)


def judge(path: Path, acknowledged: Mapping[int, str]) -> Verdict:
    """The verdict on a map whose scans are `known_embedding`s, each at a place of its own.

    `acknowledged` has the state of each session that was answered for, or `EITHER`.
    """
    if not path.exists() and not acknowledged:
        return Verdict(SAME, 'no map yet')
    try:
        stored = MapStore.open_read_only(path)
    except OffradarError as error:
        return Verdict(LOST, f'the file does not open: {error}')
    sessions = {session.session_id: session for session in stored.sessions}
    states = {number: session.state for number, session in sessions.items()}
    missing = {number: state for number, state in acknowledged.items() if states.get(number) not in state.split()}
    if missing:
        return Verdict(LOST, f'answered {missing}, found { ({number: states.get(number) for number in missing}) }')
    table = stored.places
    for number, session in sessions.items():
        rows = int((table.session_ids == number).sum())
        expected = {ENDED: session.report.get('inserted'), UNDONE: 0}.get(session.state, rows)
        if rows != expected:
            return Verdict(DIFFERENT, f'session {number}, {session.state}, has {rows} of {expected} places')
    strange = set(table.session_ids.tolist()) - set(sessions)
    if strange:
        return Verdict(DIFFERENT, f'places of sessions {strange}, which the file does not list')
    for stamp, mean in zip(table.stamps_ns.tolist(), table.means, strict=True):
        if not np.array_equal(mean, mean_of(stamp)):
            return Verdict(DIFFERENT, f'the place of stamp {stamp} holds another embedding')
    scans = map(ScanKey, table.session_ids.tolist(), table.stamps_ns.tolist())
    expected_signatures = {scan: signature_of(scan.stamp_ns) for scan in scans}
    without = expected_signatures.keys() - stored.signatures.keys()
    if without:
        return Verdict(LOST, f'{len(without)} places have lost their signatures, the first is of {min(without)}')
    if stored.signatures != expected_signatures:
        return Verdict(DIFFERENT, 'a place has another signature, or a scan has one that no place holds')
    return Verdict(SAME, f'{len(sessions)} sessions')
