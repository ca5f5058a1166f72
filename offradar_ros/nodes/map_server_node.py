"""Embeddings and positions in, the parent map out; sessions as services."""

from __future__ import annotations

import collections
import math
import sys
import time
import traceback
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.task import Future
from sensor_msgs.msg import NavSatFix, PointCloud2
from std_srvs.srv import Trigger

from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_record, model_record
from offradar_ros.ros.place_message import (
    PlaceRows,
    descriptors_message,
    map_message,
    read_the_file_message,
    receipt_message,
)
from offradar_ros.ros.run import run
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.stages.map import MapStage, MapUpdate
from offradar_ros.types import Embedding, PlaceTable

LATCHED_PLACES = 50_000
"""A larger map does not fit a message: the query node is told to read the file instead."""


QUIET_S = 0.5
"""A position that has not come this long after the one before is not waited for at the end of a session."""


class MapServerNode(StageNode):
    """Keeps, over repeated sessions, the most certain scan of each place (Algorithm 1)."""

    stages = ('position', 'map')
    timed_topic = 'embedding'

    def __init__(self, **options: Any) -> None:
        super().__init__('map_server', **options)
        self._map_view = self.publisher(PointCloud2, 'map', qos.LATCHED)
        self._rows = self.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)
        self._updates = self.publisher(PointCloud2, 'map/updates', qos.UPDATES)
        self.subscribe(DiagnosticStatus, 'embedding/model', qos.LATCHED, self._on_model)
        self.subscribe(PointCloud2, 'embedding', qos.RESULTS, self._on_embedding)
        if self.config.position.source == 'fix':
            self.subscribe(NavSatFix, 'gps/fix', qos.POSITIONS, self._on_fix)
        else:
            self.subscribe(Odometry, 'ground_truth/odometry', qos.POSITIONS, self._on_odometry)
        for name, serve in {
            'start_session': self._start_session,
            'end_session': self._end_session,
            'undo_session': self._undo_session,
            'save': self._save,
            'clear': self._clear,
        }.items():
            # In a group of its own: positions go on coming in while a session waits for them to end.
            self.create_service(Trigger, f'~/{name}', self._answering(serve), callback_group=ReentrantCallbackGroup())
        # The latched model may arrive after the first embedding; a few scans wait for it.
        self._before_model: collections.deque[Embedding] = collections.deque(maxlen=64)
        self._last_stamp_ns = 0
        self._view_is_stale = False
        self._is_in_file = False
        self._saved_s = time.monotonic()
        self._position_s = -math.inf
        self._map: SessionMap | None = None

    def configure(self) -> None:
        """Open the map."""
        self._map = SessionMap(self.config.map)
        self._stage = MapStage(self.config, self._map)

    def activated(self) -> None:
        """Publish what is known and, unless told otherwise, start a session."""
        self._publish_committed()
        self.get_logger().info(f'active: map {self.config.map.path or "in memory"}: {len(self._stage.map)} places')
        if self.config.map.start_session and self._stage.map.running_session_id is None:
            self.get_logger().info(self._start_session())

    def close(self) -> None:
        """End the running session, so that nothing of it is lost, and close the file; MapError if it cannot be."""
        if self._map is None:
            return
        if self._map.running_session_id is not None:
            _, report = self._stage.end_session()
            self.say(f'session ended at exit: {report.summary()}')
        self._map.close()
        self._map = None

    def periodic(self) -> None:
        """Refresh the view and save the running session."""
        session_map = self._stage.map
        self.status.facts |= {
            'places': str(len(session_map)),
            'mean_uncertainty': f'{session_map.mean_uncertainty:.4f}' if len(session_map) else '',
            'session': '' if session_map.running_session_id is None else str(session_map.running_session_id),
        }
        if self._view_is_stale and len(session_map) <= LATCHED_PLACES:
            self._map_view.publish(map_message(session_map.places(), self._last_stamp_ns))
            self._view_is_stale = False
        autosave_s = self.config.map.autosave_s
        if (
            self.config.map.path
            and autosave_s
            and session_map.running_session_id is not None
            and time.monotonic() - self._saved_s >= autosave_s
        ):
            try:
                self._save()
            except MapError as error:
                self._saved_s = time.monotonic()
                self.refuse(RefusedInput('not_saved', str(error)), 'map')

    def _on_model(self, message: DiagnosticStatus) -> None:
        info = model_record(message, 'embedding/model')
        known = self._stage.map.model
        try:
            self._stage.map.adopt_model(info)
        except MapError as error:
            other = known is not None and known.fingerprint != info.fingerprint
            raise RefusedInput('wrong_model' if other else 'not_saved', str(error)) from error
        waiting = list(self._before_model)
        self._before_model.clear()
        for embedding in waiting:
            self._publish_updates(self._stage.add_embedding(embedding))

    def _on_embedding(self, message: PointCloud2) -> None:
        embedding = embedding_record(message, 'embedding')
        self._last_stamp_ns = embedding.stamp_ns
        if self._stage.map.running_session_id is not None:
            if self._stage.map.model is None and len(embedding.mean):
                self._before_model.append(embedding)
            else:
                self._publish_updates(self._stage.add_embedding(embedding))
        # An update without rows says that the scan has arrived, whether or not it could be placed yet.
        self._updates.publish(receipt_message(embedding.stamp_ns))

    def _on_fix(self, message: NavSatFix) -> None:
        self._position_s = time.monotonic()
        self._publish_updates(self._stage.add_point(stamp_ns(message.header.stamp), point_from_fix(message)))

    def _on_odometry(self, message: Odometry) -> None:
        self._position_s = time.monotonic()
        self._publish_updates(self._stage.add_pose(stamp_ns(message.header.stamp), pose_from_odometry(message)))

    def _publish_updates(self, updates: Iterable[MapUpdate]) -> None:
        for update in updates:
            if update.problem:
                self.refuse(update.problem, 'embedding')
            if len(update.changed):
                self._updates.publish(self._message_of(update.changed, update.stamp_ns, committed=False))
                self._view_is_stale = True

    @property
    def _fingerprint(self) -> str:
        model = self._stage.map.model
        return model.fingerprint if model else ''

    def _publish_committed(self) -> None:
        session_map = self._stage.map
        if not session_map.model:
            return
        if len(session_map) > LATCHED_PLACES:
            self._rows.publish(read_the_file_message(self._last_stamp_ns))
            self._is_in_file = True
            return
        committed = session_map.committed()
        self._rows.publish(self._message_of(committed, self._last_stamp_ns, committed=True))
        self._map_view.publish(map_message(committed, self._last_stamp_ns))
        self._is_in_file = False

    def _message_of(self, table: PlaceTable, stamp: int, *, committed: bool) -> PointCloud2:
        return descriptors_message(PlaceRows(table, self._fingerprint, committed), stamp)

    def _answering(self, serve: Callable[[], str]) -> Callable[..., Awaitable[Trigger.Response]]:
        async def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            await self._positions_have_come()
            try:
                if self._map is None:
                    raise MapError('the map is not open: configure the node first')
                response.message = serve()
                response.success = True
                self.get_logger().info(response.message)
            except MapError as error:
                response.success, response.message = False, str(error)
                self.get_logger().error(response.message)
            except Exception as error:
                if self.context.ok():
                    self.get_logger().error(traceback.format_exc())
                response.success, response.message = False, f'internal error: {error}'
            return response

        return answer

    async def _positions_have_come(self) -> None:
        """Wait while scans wait for positions that are still being read."""
        while self._map is not None and self._stage.waiting and time.monotonic() - self._position_s < QUIET_S:
            turn = Future()
            timer = self.create_timer(
                0.02, partial(turn.set_result, None), ReentrantCallbackGroup(), Clock(clock_type=ClockType.STEADY_TIME)
            )
            await turn
            self.destroy_timer(timer)

    def _start_session(self) -> str:
        session_map = self._stage.map
        if session_map.running_session_id is not None and session_map.is_session_empty:
            return f'session {session_map.running_session_id} runs and is empty: it goes on'
        session_id = session_map.start_session('', self.now_ns())
        return f'session {session_id} started'

    def _end_session(self) -> str:
        self._publish_updates(self._stage.flush())
        changed = self._stage.map.running()
        _, report = self._stage.end_session()
        if self._is_in_file and len(self._stage.map) > LATCHED_PLACES:
            # Who reads the file has read it: what changed is less than a million places again.
            self._updates.publish(self._message_of(changed, self._last_stamp_ns, committed=True))
        else:
            self._publish_committed()
        return report.summary()

    def _undo_session(self) -> str:
        self._before_model.clear()
        undone = self._stage.undo_session()
        self._publish_committed()
        return str(undone)

    def _save(self) -> str:
        self._stage.map.save()
        self._saved_s = time.monotonic()
        return f'saved {len(self._stage.map)} places'

    def _clear(self) -> str:
        self._before_model.clear()
        backup = self._stage.clear()
        self._publish_committed()
        return f'map cleared, kept as {backup}' if backup else 'map cleared'


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(MapServerNode, args)


if __name__ == '__main__':
    sys.exit(main())
