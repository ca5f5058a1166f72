"""The signatures of the scans that an open map holds.

All of them are in memory, as the places are: where the file is taken away or overwritten under a running server, all
that was committed can be written again. Merging and undoing move scans between places; a signature stays with its scan,
and goes when neither a place nor an undo holds that scan any more.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from offradar_ros.mapping.stored_map import Before
from offradar_ros.types import PlaceTable, ScanKey

PUT_BEFORE_CHECK = 4096
"""So many signatures may be put, some 10 MB, before it is checked which of them are still needed."""


class SignatureChanges(NamedTuple):
    """What a transaction changes: signatures to write, and scans whose signatures are removed."""

    added: Mapping[ScanKey, bytes]
    removed: Collection[ScanKey]


NO_CHANGES = SignatureChanges({}, ())


class HeldSignatures:
    """Signatures by their scans, as the map has them now, and as its file has them."""

    def __init__(self, in_file: Mapping[ScanKey, bytes]) -> None:
        self._held, self._in_file = dict(in_file), dict(in_file)
        self._put = 0

    @property
    def is_check_due(self) -> bool:
        """Whether so many were put that `keep` should be called."""
        return self._put >= PUT_BEFORE_CHECK

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """The signatures of these scans, without those that have none."""
        return {scan: self._held[scan] for scan in scans if scan in self._held}

    def put(self, scan: ScanKey, signature: bytes) -> None:
        """Take up the signature of a scan that a place holds now; empty if it has none.

        What is there already is of another scan of that stamp, as of a recording that is played twice in a session. The
        place of that one is the place of this one.
        """
        self._put += 1
        self._held.pop(scan, None)
        if signature:
            self._held[scan] = signature

    def needed(self, places: PlaceTable, before: Iterable[Before]) -> dict[ScanKey, bytes]:
        """The signatures of the scans that these places hold, or held before sessions that can be undone."""
        if not self._held:
            return {}
        scans = set(places.scans())
        replaced = (place for of_session in before for place in of_session.values() if place)
        scans.update(ScanKey(place.session_id, place.stamp_ns) for place in replaced)
        return {scan: signature for scan, signature in self._held.items() if scan in scans}

    def changes(self, needed: Mapping[ScanKey, bytes]) -> SignatureChanges:
        """What makes the file hold the `needed` ones."""
        added = {scan: signature for scan, signature in needed.items() if self._in_file.get(scan) != signature}
        return SignatureChanges(added, self._in_file.keys() - needed.keys())

    def keep(self, needed: Mapping[ScanKey, bytes], *, is_written: bool) -> None:
        """Forget all but the `needed` ones; `is_written` if the file holds them, and no others, now."""
        self._held, self._put = dict(needed), 0
        if is_written:
            self._in_file = dict(needed)

    def forget_session(self, session_id: int) -> None:
        """Forget those of a session that was undone, which the file does not hold any more either."""
        for signatures in (self._held, self._in_file):
            for scan in [scan for scan in signatures if scan.session_id == session_id]:
                del signatures[scan]
