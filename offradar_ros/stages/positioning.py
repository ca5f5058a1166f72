"""Which scans get a position: scans and positions in their order of arrival, in one place for nodes and recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from offradar_ros.config import PositionConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import LeftOut
from offradar_ros.mapping.pending import PendingEmbeddings, Resolved
from offradar_ros.positions.motion import Apart
from offradar_ros.positions.order import Admitted, PositionOrder
from offradar_ros.types import Embedding, Pose

T = TypeVar('T')
Place = Callable[[int, T], Sequence[tuple[int, Pose]]]


class Positioning(Generic[T]):
    """Scans that wait for their positions, of type T.

    Args:
        config: how long a scan waits, between which positions is interpolated, and what starts again.
        place: the poses in the map frame that follow from an accepted position; RefusedInput if it is not used.
        apart: metres between two positions; without it only their stamps are looked at.
    """

    def __init__(self, config: PositionConfig, place: Place[T], apart: Apart[T] | None = None) -> None:
        self._place = place
        self._wait_ns = round(config.wait_s * 1e9)
        self._order: PositionOrder[T] = PositionOrder(round(config.restart_after_s * 1e9), apart)
        self._pending = PendingEmbeddings(config)
        self._last_scan_ns = 0
        self._left_out: dict[str, LeftOut] = {}

    def __len__(self) -> int:
        return len(self._pending)

    @property
    def scans(self) -> int:
        """Number of scans that were ever added."""
        return self._pending.added

    @property
    def heading_problem(self) -> str:
        """What is wrong with the headings that come with positions; empty if nothing is."""
        return self._pending.heading_problem

    def waits(self, scan: int) -> bool:
        """Whether any of the first `scan` scans that were added still waits."""
        return self.scans - len(self) < scan and len(self) > 0

    def add_position(self, stamp_ns: int, position: T) -> list[Resolved]:
        """Add a position; returns the scans that it resolves. RefusedInput as `PositionOrder.add`."""
        return self._resolved(self._order.add(stamp_ns, position))

    def add_scan(self, embedding: Embedding) -> list[Resolved]:
        """Add a scan; returns those that are resolved now."""
        resolved: list[Resolved] = []
        if embedding.stamp_ns < self._last_scan_ns:
            # The recording starts again: the waiting scans will get no position.
            resolved = self._pending.flush()
            resolved += self._resolved(self._order.expect_restart())
            last_ns = self._order.last_ns
            if last_ns is not None and last_ns - embedding.stamp_ns > self._wait_ns:
                resolved += self._resolved(self._order.end())
                self._order.reset()
                self._pending.forget_positions()
        self._last_scan_ns = embedding.stamp_ns
        return resolved + self._pending.add_embedding(embedding)

    def flush(self) -> list[Resolved]:
        """Resolve every waiting scan, as when no later position will arrive."""
        return self._resolved(self._order.end()) + self._pending.flush()

    def forget_scans(self) -> None:
        """Remove the waiting scans, as when their session is undone."""
        self._pending.forget_embeddings()

    def forget_positions(self) -> None:
        """Remove the positions so far, as when their frame is another one now."""
        self._pending.forget_positions()

    def take_left_out(self) -> list[LeftOut]:
        """Positions that do not count, though `add_position` did not refuse them; each is told of once."""
        left_out = list(self._left_out.values())
        self._left_out = {}
        return left_out

    def leave_out(self, left_out: LeftOut) -> None:
        """Tell of positions that do not count."""
        before = self._left_out.get(left_out.cause)
        if before is not None:
            left_out = LeftOut(left_out.cause, before.count + left_out.count, before.first)
        self._left_out[left_out.cause] = left_out

    def _refuse(self, refusal: RefusedInput) -> None:
        self.leave_out(LeftOut(refusal.cause, 1, str(refusal)))

    def _resolved(self, admitted: Admitted[T]) -> list[Resolved]:
        for refusal in admitted.left_out:
            self._refuse(refusal)
        last_ns = self._pending.last_position_ns
        starts_anew = admitted.forgotten or admitted.elsewhere
        resolved: list[Resolved] = []
        if admitted.jumped and last_ns is not None and (starts_anew or admitted.positions[0][0] <= last_ns):
            if not admitted.forgotten:
                # They wait for headings only.
                resolved = self._pending.settle()
            # Other scans that wait may still get a position of the new stretch.
            self._pending.forget_positions()
        for stamp_ns, position in admitted.positions:
            try:
                for placed_ns, pose in self._place(stamp_ns, position):
                    resolved += self._pending.add_position(placed_ns, pose)
            except RefusedInput as refusal:
                # Raised, it would take with it what was resolved before.
                self._refuse(refusal)
        return resolved
