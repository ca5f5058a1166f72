"""Embeddings and positions in, the parent map out; sessions as services."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Awaitable, Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.callback_groups import ReentrantCallbackGroup
from sensor_msgs.msg import NavSatFix, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from offradar_ros.entry_point import explain
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.mapping.session_report import SessionReport
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.positions.clocks import ArrivalClocks, clock_problem
from offradar_ros.radar.seen_stamps import SeenStamps
from offradar_ros.ros import qos
from offradar_ros.ros.diagnostics import Trouble
from offradar_ros.ros.disk_watch import disk_trouble
from offradar_ros.ros.embedding_message import embedding_record, model_record
from offradar_ros.ros.ledger import Ledger
from offradar_ros.ros.place_message import PlaceRows, descriptors_message, map_message, read_the_file_message
from offradar_ros.ros.run import run
from offradar_ros.ros.signatures_message import signatures_message, wanted_record
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.stages.map import Form, MapStage, MapUpdate

CLOCK_OFFSET_S = 2.0
"""A larger difference between the latencies of embeddings and positions is one between their clocks."""
DESTRUCTIVE = ('undo_session', 'clear')
"""The services that take mapped drives away; `map.allow_destructive` allows them."""
POLL_S = 0.02
"""Time between two checks, at the end of a session, whether positions still arrive."""
RECENT_S = 10.0
"""A scan that was dropped at most this long ago says how things are."""
RECEIVER = 'the receiver of positions'


class MapServerNode(StageNode):
    """Keeps, over repeated sessions, the most certain scan of each place (Algorithm 1)."""

    parameter_groups = ('position', 'map')
    timed_topic = 'embedding'
    stage: MapStage

    def __init__(self, **options: Any) -> None:
        super().__init__('map_server', **options)
        self._ledger = Ledger('embeddings')
        self._map_view = self.publisher(PointCloud2, 'map', qos.LATCHED)
        self._rows = self.publisher(PointCloud2, 'map/descriptors', qos.LATCHED)
        self._updates = self.publisher(PointCloud2, 'map/updates', qos.UPDATES)
        self._signatures = self.publisher(PointCloud2, 'map/signatures', qos.RESULTS)
        self._handled = self.publisher(Header, '~/handled', qos.UPDATES)
        self._model = self.subscribe(
            DiagnosticStatus,
            'embedding/model',
            qos.LATCHED,
            self._on_model,
            source='encoder_node',
            is_needed=lambda: self._maps_scans() and self.stage.map.model is None,
            check=lambda message: model_record(message, 'embedding/model'),
        )
        self._embeddings = self.subscribe(
            PointCloud2, 'embedding', qos.RESULTS, self._on_embedding, ledger=self._ledger, source='encoder_node'
        )
        if self.config.position.source == 'fix':
            self._positions = self.subscribe(
                NavSatFix,
                'gps/fix',
                qos.POSITIONS,
                self._on_fix,
                source=RECEIVER,
                instead={'nav_msgs/msg/Odometry': 'set position.source: odometry, and remap ground_truth/odometry'},
                is_needed=self._maps_scans,
            )
        else:
            self._positions = self.subscribe(
                Odometry,
                'ground_truth/odometry',
                qos.POSITIONS,
                self._on_odometry,
                source=RECEIVER,
                instead={'sensor_msgs/msg/NavSatFix': 'set position.source: fix, and remap gps/fix'},
                is_needed=self._maps_scans,
            )
        self.subscribe(PointCloud2, 'map/signatures_wanted', qos.RESULTS, self._on_wanted)
        self.create_service(Trigger, '~/start_recording', self._start_recording)
        self._seen = SeenStamps(round(self.config.position.restart_after_s * 1e9))
        for name, serve in {
            'start_session': self._start_session,
            'end_session': self._end_session,
            'undo_session': self._undo_session,
            'save': self._save,
            'clear': self._clear,
        }.items():
            # In a separate callback group: positions arrive while the end of a session waits for the last of them.
            self.create_service(
                Trigger, f'~/{name}', self._service_callback(name, serve), callback_group=ReentrantCallbackGroup()
            )
        self._last_stamp_ns = self._last_position_ns = 0
        self._refused_model = ''
        self._unsaved_model: DiagnosticStatus | None = None
        self._clocks = ArrivalClocks()
        self._map: SessionMap | None = None

    def configure(self) -> None:
        """Open the map."""
        self._map = SessionMap(self.config.map)
        for notice in self._map.notices:
            self.get_logger().warning(notice)
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
        is_running = self._map.running_session_id is not None
        if is_running:
            # Also for a rescue: without the file nothing is ended.
            self.stage.flush()
        self._map.require_file()
        if is_running:
            _, report = self.stage.end_session()
            self.log_info(f'session ended at exit: {self._summary(report)}')
        self._map.close()
        self._map = None

    def rescue(self) -> str:
        """Write the map that `close` could not write as a new file; MapError if that fails too."""
        rescued = self._map.rescue() if self._map is not None else None
        return f'the whole map was written to {rescued}' if rescued else ''

    def periodic(self) -> None:
        """Refresh the view and save the running session."""
        session_map = self.stage.map
        self.status.facts |= {
            'places': str(len(session_map)),
            'mean_uncertainty': f'{session_map.mean_uncertainty:.4f}' if len(session_map) else '',
            'session': '' if session_map.running_session_id is None else str(session_map.running_session_id),
            'file': 'complete'
            if session_map.is_file_complete
            else 'copy it with offradar map --backup: it is being read',
        }
        view = self.stage.changed_view()
        if view is not None:
            self._map_view.publish(map_message(view, self._last_stamp_ns))
        self.guarded('map', self.stage.autosave)
        if self._unsaved_model is not None:
            self.guarded('embedding/model', partial(self._on_model, self._unsaved_model))

    def troubles(self) -> Iterator[Trouble]:
        """The map is of another model or cannot be written, or positions are of another time than the scans."""
        if self._refused_model:
            yield Trouble('wrong_model', self._refused_model, is_error=True)
        # Saving is tried again only now and then.
        if unsaved := self.status.recent_reason('not_saved', max(RECENT_S, 2 * self.config.map.autosave_s)):
            yield Trouble('not_saved', unsaved, is_error=True)
        elif self.config.map.path and (trouble := disk_trouble(Path(self.config.map.path))):
            yield trouble
        if problem := self.stage.problem():
            yield Trouble('origin', problem, is_error=True)
        if problem := self.stage.heading_problem():
            yield Trouble('heading', problem)
        # An embedding arrives later than its scan by what the encoder takes.
        if clocks := clock_problem(self._clocks.offset_s(), CLOCK_OFFSET_S):
            yield Trouble('clocks_apart', clocks)
        elif self.status.recent_reason('no_position', RECENT_S) and not self._positions.watch.is_silent:
            yield Trouble('positions_apart', f'scans have no position, though positions come: {self._why_apart()}')

    def _why_apart(self) -> str:
        apart_s, gap_s = (self._last_position_ns - self._last_stamp_ns) / 1e9, self.config.position.max_gap_s
        if abs(apart_s) <= gap_s:
            return f'more than position.max_gap_s = {gap_s:g} s lies between two of them: send more, or raise it'
        return (
            f'the last one is {abs(apart_s):.1f} s {"before" if apart_s < 0 else "after"} the last scan by their '
            'stamps: set both clocks by one source, or raise position.wait_s if positions are late'
        )

    def _maps_scans(self) -> bool:
        """Whether a session runs and scans come, so that the map lacks what does not."""
        running = self._map is not None and self.stage.map.running_session_id is not None
        return running and not self._embeddings.watch.is_silent

    def _start_recording(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take every stamp again: a recording that is played again has the same."""
        self._seen.reset()
        response.success, response.message = True, 'a recording starts with the next scan'
        return response

    def _on_model(self, message: DiagnosticStatus) -> None:
        model = model_record(message, 'embedding/model')
        self._unsaved_model = None
        try:
            self._publish_updates(self.stage.adopt_model(model))
        except RefusedInput as problem:
            if problem.cause == 'not_saved':
                # It is sent once; there may be space for it later.
                self._unsaved_model = message
            self._refused_model = str(problem) if problem.cause == 'wrong_model' else ''
            raise
        self._refused_model = ''

    def _on_embedding(self, message: PointCloud2) -> None:
        self._last_stamp_ns = stamp_ns(message.header.stamp)
        self._clocks.add_scan(time.monotonic_ns(), self._last_stamp_ns)
        try:
            embedding = embedding_record(message, 'embedding')
            # One that could not be encoded may be encoded by a second encoder.
            if len(embedding.mean):
                self._seen.check(embedding.stamp_ns, embedding.model)
            self._publish_updates(self.stage.add_embedding(embedding))
        finally:
            # For a replay in lockstep: it sends the next scan when this one is in the map, or refused.
            if self._handled.get_subscription_count():
                self._handled.publish(Header(stamp=message.header.stamp))
        self._ledger.settle('taken_up')

    def _on_fix(self, message: NavSatFix) -> None:
        self._last_position_ns = stamp_ns(message.header.stamp)
        self._clocks.add_position(time.monotonic_ns(), self._last_position_ns)
        self._publish_updates(self.stage.add_point(stamp_ns(message.header.stamp), point_from_fix(message)))

    def _on_odometry(self, message: Odometry) -> None:
        self._last_position_ns = stamp_ns(message.header.stamp)
        self._clocks.add_position(time.monotonic_ns(), self._last_position_ns)
        self._publish_updates(self.stage.add_pose(stamp_ns(message.header.stamp), pose_from_odometry(message)))

    def _on_wanted(self, message: PointCloud2) -> None:
        found = self.stage.signatures(wanted_record(message, 'map/signatures_wanted'))
        self._signatures.publish(signatures_message(found, self._last_stamp_ns))

    def _publish_updates(self, updates: Iterable[MapUpdate]) -> None:
        for left_out in self.stage.take_left_out():
            self.refuse(RefusedInput(left_out.cause, left_out.first), 'position', left_out.count)
        if self.stage.take_discarded():
            self.get_logger().warning('what was mapped of this session lay around a wrong fix: discarded')
            self._publish_committed()
        for update in updates:
            if update.problem:
                self.refuse(update.problem, 'embedding')
            if len(update.changed):
                signatures = (update.signature,) * len(update.changed)
                rows = PlaceRows(update.changed, self._fingerprint, committed=False, signatures=signatures)
                self._updates.publish(descriptors_message(rows, update.stamp_ns))

    def _publish_committed(self) -> None:
        committed = self.stage.committed()
        if committed is None:
            return
        if committed.form is Form.FILE:
            self._rows.publish(read_the_file_message(self._last_stamp_ns))
        elif committed.form is Form.CHANGES:
            # Whoever has read the file reads the signatures there.
            if len(committed.table):
                rows = PlaceRows(committed.table, self._fingerprint, committed=True)
                self._updates.publish(descriptors_message(rows, self._last_stamp_ns))
        else:
            rows = PlaceRows(committed.table, self._fingerprint, committed=True, checksums=committed.checksums)
            self._rows.publish(descriptors_message(rows, self._last_stamp_ns))
            self._map_view.publish(map_message(committed.table, self._last_stamp_ns))

    @property
    def _fingerprint(self) -> str:
        model = self.stage.map.model
        return model.fingerprint if model else ''

    def _service_callback(self, name: str, serve: Callable[[], str]) -> Callable[..., Awaitable[Trigger.Response]]:
        async def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                if name in DESTRUCTIVE and not self.config.map.allow_destructive:
                    raise MapError(
                        f'{name} takes mapped drives away, for any caller, so it is off: start the map server '
                        'with map.allow_destructive:=true to allow it'
                    )
                await self._wait_for_positions()
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
                    self.get_logger().error(explain(error) or traceback.format_exc())
                response.success, response.message = False, explain(error) or f'internal error: {error!r}'
            return response

        return answer

    async def _wait_for_positions(self) -> None:
        """Wait while scans that have come up to now wait for positions that still arrive, `position.wait_s` at most."""
        if self._map is None:
            return
        scans, end_s = self.stage.scans, time.monotonic() + self.config.position.wait_s
        while self._map is not None and self.stage.expects_positions(scans) and time.monotonic() < end_s:
            await self.pause(POLL_S)

    def _start_session(self) -> str:
        return self.stage.start_session(self.now_ns())

    def _end_session(self) -> str:
        # Scans that are merged now stay merged and are published, even if the session cannot be committed.
        self._publish_updates(self.stage.flush())
        updates, report = self.stage.end_session()
        self._publish_updates(updates)
        self._publish_committed()
        return self._summary(report)

    def _summary(self, report: SessionReport) -> str:
        """The report as one line, with why there were no positions if none ever came."""
        text = report.summary()
        if report.dropped.get('no_position') and not self._positions.watch.ever:
            name = self._positions.subscription.topic_name
            # What was the matter during the drive: afterwards the receiver may be off.
            why = self._positions.last_why or (self._positions.why_silent() if self.context.ok() else '')
            text += f'; no position ever came on {name}{f": {why}" if why else ""}'
        return text

    def _undo_session(self) -> str:
        undone = self.stage.undo_session()
        self._publish_committed()
        return str(undone)

    def _save(self) -> str:
        again = ', the whole map, where its file was removed' if self.stage.save() else ''
        return f'saved {len(self.stage.map)} places{again}'

    def _clear(self) -> str:
        backup = self.stage.clear()
        self._publish_committed()
        return f'map cleared, kept as {backup}' if backup else 'map cleared'


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(MapServerNode, args)


if __name__ == '__main__':
    sys.exit(main())
