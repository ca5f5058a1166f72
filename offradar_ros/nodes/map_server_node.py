"""Embeddings and positions in, the parent map out; sessions as services."""

from __future__ import annotations

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
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from offradar_ros.errors import MapError
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.positions.clocks import ArrivalClocks, clock_problem
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_record, model_record
from offradar_ros.ros.place_message import PlaceRows, descriptors_message, map_message, read_the_file_message
from offradar_ros.ros.run import run
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.stages.map import Form, MapStage, MapUpdate
from offradar_ros.types import PlaceTable

CLOCK_OFFSET_S = 2.0
"""A larger difference between the latencies of embeddings and positions is one between their clocks."""
POLL_S = 0.02
"""Time between two checks, at the end of a session, whether positions still arrive."""


class MapServerNode(StageNode):
    """Keeps, over repeated sessions, the most certain scan of each place (Algorithm 1)."""

    parameter_groups = ('position', 'map')
    timed_topic = 'embedding'
    stage: MapStage

    def __init__(self, **options: Any) -> None:
        super().__init__('map_server', **options)
        self._map_view = self.publisher(PointCloud2, 'map', qos.LATCHED)
        self._rows = self.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)
        self._updates = self.publisher(PointCloud2, 'map/updates', qos.UPDATES)
        self._handled = self.publisher(Header, '~/handled', qos.UPDATES)
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
            # In a separate callback group: positions arrive while the end of a session waits for the last of them.
            self.create_service(
                Trigger, f'~/{name}', self._service_callback(serve), callback_group=ReentrantCallbackGroup()
            )
        self._last_stamp_ns = 0
        self._clocks = ArrivalClocks()
        self._map: SessionMap | None = None

    def configure(self) -> None:
        """Open the map."""
        self._map = SessionMap(self.config.map)
        self.stage = MapStage(self.config, self._map)

    def activated(self) -> None:
        """Publish the map and, where `map.start_session` is true, start a session."""
        self._publish_committed()
        self.get_logger().info(f'active: map {self.config.map.path or "in memory"}: {len(self.stage.map)} places')
        if self.config.map.start_session and self.stage.map.running_session_id is None:
            self.get_logger().info(self._start_session())

    def close(self) -> None:
        """End the running session, so that none of it is lost, and close the file; MapError if that fails."""
        if self._map is None:
            return
        if self._map.running_session_id is not None:
            _, report = self.stage.end_session()
            self.log_info(f'session ended at exit: {report.summary()}')
        self._map.close()
        self._map = None

    def periodic(self) -> None:
        """Refresh the view and save the running session."""
        session_map = self.stage.map
        self.status.facts |= {
            'places': str(len(session_map)),
            'mean_uncertainty': f'{session_map.mean_uncertainty:.4f}' if len(session_map) else '',
            'session': '' if session_map.running_session_id is None else str(session_map.running_session_id),
        }
        # An embedding arrives later than its scan by what the encoder takes.
        by_arrival = clock_problem(self._clocks.offset_s(), CLOCK_OFFSET_S)
        self.status.warning = self.stage.problem() or by_arrival
        view = self.stage.changed_view()
        if view is not None:
            self._map_view.publish(map_message(view, self._last_stamp_ns))
        self.guarded('map', self.stage.autosave)

    def _on_model(self, message: DiagnosticStatus) -> None:
        self._publish_updates(self.stage.adopt_model(model_record(message, 'embedding/model')))

    def _on_embedding(self, message: PointCloud2) -> None:
        self._last_stamp_ns = stamp_ns(message.header.stamp)
        self._clocks.add_scan(time.monotonic_ns(), self._last_stamp_ns)
        try:
            self._publish_updates(self.stage.add_embedding(embedding_record(message, 'embedding')))
        finally:
            # For a replay in lockstep: it sends the next scan when this one is in the map, or refused.
            if self._handled.get_subscription_count():
                self._handled.publish(Header(stamp=message.header.stamp))

    def _on_fix(self, message: NavSatFix) -> None:
        self._clocks.add_position(time.monotonic_ns(), stamp_ns(message.header.stamp))
        self._publish_updates(self.stage.add_point(stamp_ns(message.header.stamp), point_from_fix(message)))

    def _on_odometry(self, message: Odometry) -> None:
        self._clocks.add_position(time.monotonic_ns(), stamp_ns(message.header.stamp))
        self._publish_updates(self.stage.add_pose(stamp_ns(message.header.stamp), pose_from_odometry(message)))

    def _publish_updates(self, updates: Iterable[MapUpdate]) -> None:
        for left_out in self.stage.take_left_out():
            self.refuse(left_out, 'position')
        if self.stage.take_discarded():
            self.get_logger().warning('what was mapped of this session lay around a wrong fix: discarded')
            self._publish_committed()
        for update in updates:
            if update.problem:
                self.refuse(update.problem, 'embedding')
            self._publish_changed(update.changed, update.stamp_ns, committed=False)

    def _publish_changed(self, table: PlaceTable, stamp: int, *, committed: bool) -> None:
        if len(table):
            self._updates.publish(self._rows_message(table, stamp, committed=committed))

    def _publish_committed(self) -> None:
        committed = self.stage.committed()
        if committed is None:
            return
        if committed.form is Form.FILE:
            self._rows.publish(read_the_file_message(self._last_stamp_ns))
        elif committed.form is Form.CHANGES:
            self._publish_changed(committed.table, self._last_stamp_ns, committed=True)
        else:
            self._rows.publish(self._rows_message(committed.table, self._last_stamp_ns, committed=True))
            self._map_view.publish(map_message(committed.table, self._last_stamp_ns))

    def _rows_message(self, table: PlaceTable, stamp: int, *, committed: bool) -> PointCloud2:
        model = self.stage.map.model
        return descriptors_message(PlaceRows(table, model.fingerprint if model else '', committed), stamp)

    def _service_callback(self, serve: Callable[[], str]) -> Callable[..., Awaitable[Trigger.Response]]:
        async def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            await self._wait_for_positions()
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

    async def _wait_for_positions(self) -> None:
        """Wait while scans wait for positions that still arrive."""
        while self._map is not None and self.stage.expects_positions:
            elapsed = Future()
            timer = self.create_timer(
                POLL_S,
                partial(elapsed.set_result, None),
                ReentrantCallbackGroup(),
                Clock(clock_type=ClockType.STEADY_TIME),
            )
            await elapsed
            self.destroy_timer(timer)

    def _start_session(self) -> str:
        return self.stage.start_session(self.now_ns())

    def _end_session(self) -> str:
        # Scans that are merged now stay merged and are published, even if the session cannot be committed.
        self._publish_updates(self.stage.flush())
        updates, report = self.stage.end_session()
        self._publish_updates(updates)
        self._publish_committed()
        return report.summary()

    def _undo_session(self) -> str:
        undone = self.stage.undo_session()
        self._publish_committed()
        return str(undone)

    def _save(self) -> str:
        self.stage.save()
        return f'saved {len(self.stage.map)} places'

    def _clear(self) -> str:
        backup = self.stage.clear()
        self._publish_committed()
        return f'map cleared, kept as {backup}' if backup else 'map cleared'


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(MapServerNode, args)


if __name__ == '__main__':
    sys.exit(main())
