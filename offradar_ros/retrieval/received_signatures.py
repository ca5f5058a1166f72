"""The signatures of the scans that a searched map holds, where they come by messages.

Those of the running session come with its rows. A map that comes at once only has their checksums, and what is missing
is asked for: a few scans at a time, the next few when the answer to the last question is there, so that neither side is
ever flooded.
"""

from __future__ import annotations

import collections
import itertools
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence

from offradar_ros.alignment.signature_code import checksum_of, is_of_checksum, unpack
from offradar_ros.errors import RefusedInput
from offradar_ros.types import ScanKey

MOST_WANTED = 64
"""Most scans of a question. Its answer, of 2 to 3 kB a scan, passes through Fast DDS' shared memory in one piece."""
ASK_AGAIN_S = 1.0
"""A question without an answer after this time was lost, or its answer was."""
PUT_BEFORE_CHECK = 4096
"""So many signatures may be put, some 10 MB, before it is checked which of them are still needed."""


class ReceivedSignatures:
    """A `SignatureSource` that says which signatures it still lacks. Not thread-safe.

    Args:
        clock: monotonic time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._held: dict[ScanKey, bytes] = {}
        # Checksums, in the order in which the signatures are asked for.
        self._missing: collections.OrderedDict[ScanKey, int] = collections.OrderedDict()
        self._asked: tuple[ScanKey, ...] = ()
        self._asked_s = -math.inf
        self._put = 0

    def __len__(self) -> int:
        """Number of signatures that are here."""
        return len(self._held)

    @property
    def missing(self) -> int:
        """Number of signatures that the map has, and that have not come yet."""
        return len(self._missing)

    @property
    def is_check_due(self) -> bool:
        """Whether so many were put that `keep` should be called."""
        return self._put >= PUT_BEFORE_CHECK

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """The signatures of these scans that are here; those that are not are asked for first."""
        for scan in reversed(scans):
            if scan in self._missing:
                self._missing.move_to_end(scan, last=False)
        return {scan: self._held[scan] for scan in scans if scan in self._held}

    def expect(self, checksums: Mapping[ScanKey, int]) -> None:
        """The scans of the map have signatures of these checksums from now on, 0 for none, and no others are needed.

        What is not here is asked for, also if it was before: the map may be that of another server.
        """
        every = {scan: checksum for scan, checksum in checksums.items() if checksum}
        here = {scan: self._held[scan] for scan in every if scan in self._held}
        self._held = {scan: content for scan, content in here.items() if checksum_of(content) == every[scan]}
        missing = ((scan, checksum) for scan, checksum in every.items() if scan not in self._held)
        self._missing = collections.OrderedDict(missing)
        self._asked, self._put = (), 0

    def put(self, scan: ScanKey, signature: bytes) -> None:
        """Take up the signature of a scan that came with its row; empty if it has none."""
        self._put += 1
        self._missing.pop(scan, None)
        self._held.pop(scan, None)
        if signature:
            self._held[scan] = signature

    def keep(self, scans: Iterable[ScanKey]) -> None:
        """Forget the signatures of all scans but these."""
        self._held = {scan: self._held[scan] for scan in scans if scan in self._held}
        self._put = 0

    def wanted(self) -> tuple[ScanKey, ...]:
        """The scans to ask for now, at most `MOST_WANTED`; none while the last question may still be answered."""
        if not self._missing:
            return ()
        if self._asked:
            if self._clock() - self._asked_s < ASK_AGAIN_S:
                return ()
            # One that can never be answered must not keep the others waiting.
            for scan in self._asked:
                if scan in self._missing:
                    self._missing.move_to_end(scan)
        self._asked, self._asked_s = tuple(itertools.islice(self._missing, MOST_WANTED)), self._clock()
        return self._asked

    def receive(self, answer: Mapping[ScanKey, bytes]) -> list[RefusedInput]:
        """Take up the signatures of an answer, also to the question of another, as far as they are missing.

        An empty one says that the server has none any more. Returns what is wrong with others (`invalid_signature`).
        One that is damaged, or not that of the map, is asked for again; one that is as in the map, which another
        version of this package may have made, is not.
        """
        problems: list[RefusedInput] = []
        for scan in [scan for scan in answer if scan in self._missing]:
            content = answer[scan]
            if content and not is_of_checksum(content, self._missing[scan]):
                text = f'signature of scan {scan.stamp_ns} ns: not the one in the map, or damaged; dropped'
                problems.append(RefusedInput('invalid_signature', text))
                continue
            del self._missing[scan]
            if not content:
                continue
            try:
                unpack(content)
            except RefusedInput as problem:
                problems.append(problem)
            else:
                self._held[scan] = content
        # Not for one that has to be asked for again: that would be at once, and for ever.
        if any(scan in answer and scan not in self._missing for scan in self._asked):
            self._asked = ()
        return problems
