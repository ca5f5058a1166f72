"""Where the signatures of places that resemble a query come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from offradar_ros.types import ScanKey


class SignatureSource(Protocol):
    """Signatures by their scans.

    `ReceivedSignatures` from a map server, `SignatureFile` beside one, `HeldSignatures` of a map in this process.
    """

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """The packed signatures of these scans, without those that have none; MapError if they cannot be read."""
