"""Packed signatures of recorded or simulated drives, made when they are first read."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.scan_odometry import ScanOdometry
from offradar_ros.alignment.signature import Signature, SignatureMaker
from offradar_ros.alignment.signature_code import pack
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.types import PolarScan, ScanKey

SCANS_BEFORE = 3
"""Scans from which the velocity at a scan is found: three give two estimates that can agree, or one that is held."""
_HELD = 64
"""Images that are kept for the velocity of the scans that follow."""


class Scans(Protocol):
    """All scans of a drive, in time order, which none is left out of: a velocity comes from the scans before."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 scan stamps."""

    def scan(self, index: int) -> PolarScan:
        """Scan `index`; RefusedInput or DataError for one that cannot be used."""


class DriveSignatures:
    """Signatures of several drives, which are sessions 0, 1, … in the keys of their scans. Not thread-safe.

    Their velocities are those of the drive's few scans before, as a vehicle's are of all scans. Scans that cannot be
    read have none.
    """

    def __init__(self, drives: Sequence[Scans]) -> None:
        self._drives, self._make = drives, SignatureMaker()
        self._plain: collections.OrderedDict[tuple[int, int], Signature | None] = collections.OrderedDict()
        self._made: dict[ScanKey, bytes] = {}

    def number_of(self, drive: Scans) -> int:
        """The session of a drive in the keys of its scans."""
        return next(number for number, one in enumerate(self._drives) if one is drive)

    def of(self, drive: Scans, row: int) -> bytes:
        """The signature of scan `row`; empty for none."""
        return self._of(self.number_of(drive), row)

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """As `SignatureSource.read`."""
        found = {}
        for key in scans:
            (row, *_) = np.flatnonzero(self._drives[key.session_id].stamps_ns == key.stamp_ns).tolist()
            if made := self._of(key.session_id, row):
                found[key] = made
        return found

    def _of(self, number: int, row: int) -> bytes:
        stamps_ns = self._drives[number].stamps_ns
        key = ScanKey(number, int(stamps_ns[row]))
        if key not in self._made:
            own, odometry, twist = self._plain_of(number, row), ScanOdometry(), None
            for before in range(max(row - SCANS_BEFORE, 0), row + 1) if own else ():
                if plain := self._plain_of(number, before):
                    twist = odometry.twist(plain, int(stamps_ns[before]))
            self._made[key] = pack(dataclasses.replace(own, twist=twist)) if own else b''
        return self._made[key]

    def _plain_of(self, number: int, row: int) -> Signature | None:
        """The signature without a velocity."""
        if (number, row) not in self._plain:
            self._plain[number, row] = None
            with contextlib.suppress(RefusedInput, DataError):
                self._plain[number, row] = self._make(self._drives[number].scan(row))
            while len(self._plain) > _HELD:
                self._plain.popitem(last=False)
        return self._plain[number, row]
