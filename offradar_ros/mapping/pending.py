"""Embeddings that wait for the pose at their stamp."""

from __future__ import annotations

import collections
import dataclasses

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import NoPosition, PositionBuffer
from offradar_ros.positions.headings import Headings
from offradar_ros.types import Embedding, Pose

MAX_WAITING = 16_384
"""Most embeddings that wait: a scan for each 0.04 s of the longest `position.wait_s`."""

MAX_WAITING_BYTES = 128 * 2**20
"""Most memory of the embeddings that wait."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Resolved:
    """An embedding that no longer waits: with its pose, or without one, and then `cause` says why it is dropped."""

    embedding: Embedding
    pose: Pose | None
    cause: str = ''


class PendingEmbeddings:
    """A queue of embeddings: they leave in the order in which they were added, whatever the order of positions."""

    def __init__(self, config: PositionConfig) -> None:
        self._wait_ns = round(config.wait_s * 1e9)
        max_gap_ns = round(config.max_gap_s * 1e9)
        self._headings = Headings(config.heading, max_gap_ns)
        self._positions = PositionBuffer(max_gap_ns)
        self._waiting: collections.deque[Embedding] = collections.deque()
        self._waiting_bytes = 0
        self._newest_ns = 0
        self._added = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def added(self) -> int:
        """Number of embeddings that were ever added; those that wait are the last of them."""
        return self._added

    @property
    def last_position_ns(self) -> int | None:
        """Stamp of the newest position."""
        return self._headings.last_ns

    @property
    def heading_problem(self) -> str:
        """What is wrong with the headings that come with positions; empty if nothing is."""
        return self._headings.problem

    def add_position(self, stamp_ns: int, pose: Pose) -> list[Resolved]:
        """Add a position; returns the embeddings that it resolves, by the heading that it decides of those before it.

        RefusedInput if it is not finite or not newer than the last.
        """
        self._take_positions(self._headings.add(stamp_ns, pose))
        return self._resolve()

    def add_embedding(self, embedding: Embedding) -> list[Resolved]:
        """Add an embedding; returns what is resolved now, this one included if its position is known already.

        Where too many wait, whose stamps may all be equal, the oldest ones are dropped (`too_many_waiting`).
        """
        self._newest_ns = max(self._newest_ns, embedding.stamp_ns) if self._waiting else embedding.stamp_ns
        self._waiting.append(embedding)
        self._added += 1
        self._waiting_bytes += _bytes_of(embedding)
        resolved = self._resolve()
        while len(self._waiting) > MAX_WAITING or self._waiting_bytes > MAX_WAITING_BYTES:
            resolved.append(Resolved(self._take(), None, 'too_many_waiting'))
        return resolved

    def settle(self) -> list[Resolved]:
        """Resolve the embeddings between the positions so far, whose headings no later position will decide."""
        self._take_positions(self._headings.settle())
        return self._resolve()

    def flush(self) -> list[Resolved]:
        """Resolve every waiting embedding: those without a position are dropped, as at the end of a recording."""
        return self._resolve(final=True)

    def forget_embeddings(self) -> None:
        """Remove the waiting embeddings, as when their session is undone; positions stay."""
        self._waiting.clear()
        self._waiting_bytes = 0

    def forget_positions(self) -> None:
        """Remove the positions, as when they belong to an earlier run; embeddings still wait."""
        self._headings.reset()
        self._positions.clear()

    def _take_positions(self, positions: list[tuple[int, Pose]]) -> None:
        for stamp_ns, pose in positions:
            self._positions.add(stamp_ns, pose)

    def _take(self) -> Embedding:
        embedding = self._waiting.popleft()
        self._waiting_bytes -= _bytes_of(embedding)
        return embedding

    def _resolve(self, final: bool = False) -> list[Resolved]:
        resolved: list[Resolved] = []
        while self._waiting:
            pose = self._positions.at(self._waiting[0].stamp_ns)
            overdue = final or self._newest_ns - self._waiting[0].stamp_ns > self._wait_ns
            if pose is NoPosition.NOT_YET:
                if not overdue:
                    break
                # A position whose heading is not known for sure is one all the same.
                self._take_positions(self._headings.settle())
                pose = self._positions.at(self._waiting[0].stamp_ns)
            embedding = self._take()
            if isinstance(pose, Pose):
                resolved.append(Resolved(embedding, pose))
            else:
                resolved.append(Resolved(embedding, None, 'no_position'))
        return resolved


def _bytes_of(embedding: Embedding) -> int:
    return int(embedding.mean.nbytes) + int(embedding.variance.nbytes) + len(embedding.signature)
