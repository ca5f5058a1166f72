"""The second stage: embeddings and positions in, map updates out."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import Config
from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.mapping.pending import PendingEmbeddings, Settled
from offradar_ros.mapping.session_report import SessionReport, UndoReport
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.types import Embedding, PlaceTable, Pose

MAX_EXTENT_M = 100_000.0
"""A flat frame is no map beyond this."""


@dataclasses.dataclass(frozen=True)
class MapUpdate:
    """What one embedding did to the map.

    Attributes:
        stamp_ns: of the embedding.
        changed: the rows that the running session inserted or replaced with it; may be empty.
        problem: why it was not merged, or None.
    """

    stamp_ns: int
    changed: PlaceTable
    problem: RefusedInput | None = None


class MapStage:
    """Embeddings and positions in, map updates out, each embedding once and in order of arrival."""

    def __init__(self, config: Config, session_map: SessionMap) -> None:
        self.map = session_map
        self._pending = PendingEmbeddings(config.position)
        self._frame = LocalFrame(session_map.origin) if session_map.origin else None
        self._restart_after_ns = round(config.position.restart_after_s * 1e9)
        self._wait_ns = round(config.position.wait_s * 1e9)
        self._last_scan_ns = 0

    def add_point(self, stamp: int, point: GeoPoint) -> list[MapUpdate]:
        """A geodetic position. The map's frame starts at the first one of the drive whose scan is mapped first.

        RefusedInput('far_position') for one further than `MAX_EXTENT_M` from where the frame starts, such as 0°, 0°.
        """
        frame = self._frame or LocalFrame(point)
        enu = self._enu(frame, point)
        if np.linalg.norm(enu) > MAX_EXTENT_M:
            if self.map.origin:
                kilometres = np.linalg.norm(enu) / 1000.0
                raise RefusedInput(
                    'far_position',
                    f'position {point.latitude_deg:.5f}°, {point.longitude_deg:.5f}° is {kilometres:.0f} km from the '
                    f"map's origin: expected at most {MAX_EXTENT_M / 1000.0:.0f} km",
                )
            # Nothing is mapped yet: it was the first position that was wrong.
            self._pending.forget_positions()
            frame = LocalFrame(point)
            enu = self._enu(frame, point)
        self._frame = frame
        return self.add_pose(stamp, Pose(float(enu[0]), float(enu[1]), float(enu[2])))

    @staticmethod
    def _enu(frame: LocalFrame, point: GeoPoint) -> NDArray[np.float64]:
        lla = np.array([[point.latitude_deg, point.longitude_deg, point.altitude_m]])
        enu: NDArray[np.float64] = frame.to_enu(lla)[0]
        return enu

    def add_pose(self, stamp: int, pose: Pose) -> list[MapUpdate]:
        """A pose in the map frame; RefusedInput if it is invalid or not newer than the last."""
        updates: list[MapUpdate] = []
        last_ns = self._pending.last_position_ns
        if last_ns is not None and last_ns - stamp > self._restart_after_ns:
            updates = self.flush()
            self._pending.clear()
        return updates + self._merged(self._pending.add_position(stamp, pose))

    def add_embedding(self, embedding: Embedding) -> list[MapUpdate]:
        """An embedding, merged as soon as its position is known."""
        if not len(embedding.mean):
            problem = RefusedInput(
                'invalid_embedding', f'scan {embedding.stamp_ns} ns could not be encoded: not mapped'
            )
            return [self._refused(embedding, problem)]
        updates: list[MapUpdate] = []
        if embedding.stamp_ns < self._last_scan_ns:
            # The recording starts again: nothing that still waits will get its position.
            updates = self.flush()
            last_ns = self._pending.last_position_ns
            if last_ns is not None and last_ns - embedding.stamp_ns > self._wait_ns:
                self._pending.forget_positions()
        self._last_scan_ns = embedding.stamp_ns
        return updates + self._merged(self._pending.add_embedding(embedding))

    @property
    def waiting(self) -> int:
        """Embeddings whose position is not known yet."""
        return len(self._pending)

    def flush(self) -> list[MapUpdate]:
        """Settle what still waits: no later position will come for it."""
        return self._merged(self._pending.flush())

    def undo_session(self) -> UndoReport:
        """Take back the running session, with what still waits, or else the one that ended last."""
        self._pending.forget_embeddings()
        return self.map.undo_session()

    def clear(self) -> Path | None:
        """Empty the map, and forget what still waits; returns the copy that was kept."""
        self._pending.forget_embeddings()
        return self.map.clear()

    def end_session(self) -> tuple[list[MapUpdate], SessionReport]:
        """Flush, then commit the running session."""
        return self.flush(), self.map.end_session()

    def _merged(self, settled: Iterable[Settled]) -> list[MapUpdate]:
        return [self._merge(item) for item in settled]

    def _merge(self, settled: Settled) -> MapUpdate:
        embedding = settled.embedding
        if settled.pose is None:
            problem = RefusedInput(
                settled.cause, f'no position within reach of scan {embedding.stamp_ns} ns: not mapped'
            )
            return self._refused(embedding, problem)
        try:
            if self.map.origin is None and self._frame is not None and self.map.running_session_id is not None:
                self.map.set_origin(self._frame.origin)
            merge = self.map.merge(embedding, settled.pose)
        except RefusedInput as refused:
            return self._refused(embedding, refused)
        return MapUpdate(embedding.stamp_ns, self.map.changed(merge))

    def _refused(self, embedding: Embedding, problem: RefusedInput) -> MapUpdate:
        self.map.note_dropped(problem.cause)
        return MapUpdate(embedding.stamp_ns, PlaceTable.from_places([], self.map.dimension), problem)
