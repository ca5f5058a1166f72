"""Embeddings in, a match or a reasoned rejection out."""

from __future__ import annotations

import math
import sys
import time
import traceback
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.callback_groups import ReentrantCallbackGroup
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from offradar_ros.config import Config
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.mapping.map_reader import status_of
from offradar_ros.messages import pose_from_odometry, stamp_ns
from offradar_ros.radar.seen_stamps import SeenStamps
from offradar_ros.ros import qos
from offradar_ros.ros.answer_watch import AnswerWatch
from offradar_ros.ros.diagnostics import Trouble
from offradar_ros.ros.embedding_message import embedding_record
from offradar_ros.ros.ledger import Ledger
from offradar_ros.ros.localisation_message import localisation_message, localisation_pose_message
from offradar_ros.ros.outcome_message import (
    match_message,
    match_pose_message,
    rejection_message,
    vehicle_pose_message,
)
from offradar_ros.ros.place_message import descriptors_record, is_read_the_file
from offradar_ros.ros.run import run
from offradar_ros.ros.signatures_message import signatures_record, wanted_message
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.stages.initial_pose import InitialPose
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, LocalisationState, Match, Outcome, Reason, Rejection

POLL_S = 0.02
"""Time between two checks, at the start of a recording, whether signatures still come."""
PATIENCE_S = 4.0
"""A recording starts without signatures of which none came for this time, in which they are asked for twice."""


class QueryNode(StageNode):
    """Answers each embedding exactly once, on `matches` (and `match_pose`) or on `rejections`.

    `localisation` says where the vehicle is after all scans up to now.
    """

    parameter_groups = ('query', 'localisation')
    timed_topic = 'embedding'

    def __init__(self, **options: Any) -> None:
        super().__init__('query', **options)
        self.stage = QueryStage(self.config.query, self.config.localisation)
        self._ledger, self._update_ledger = Ledger('embeddings'), Ledger('updates')
        self._matches = self.publisher(PointCloud2, 'matches', qos.RESULTS)
        self._poses = self.publisher(PoseWithCovarianceStamped, 'match_pose', qos.RESULTS)
        self._rejections = self.publisher(DiagnosticArray, 'rejections', qos.RESULTS)
        self._localisations = self.publisher(DiagnosticArray, 'localisation', qos.RESULTS)
        self._localisation_poses = self.publisher(PoseWithCovarianceStamped, 'localisation_pose', qos.RESULTS)
        self._p_on_map = self.publisher(Float64, 'p_on_map', qos.RESULTS)
        # Each query node of a map server asks there.
        self._wanted = self.publisher(PointCloud2, 'map/signatures_wanted', qos.RESULTS, is_shared=True)
        self._initial, self._initial_poses = InitialPose(), None
        if self.config.query.initial_pose:
            self._initial_poses = self.publisher(PoseWithCovarianceStamped, 'initialpose', qos.RESULTS)
        self.create_service(Trigger, '~/relocalise', self._relocalise)
        # In a separate callback group: signatures arrive while the answer waits for them.
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, '~/start_recording', self._start_recording, callback_group=group)
        self._last_stamp_ns = 0
        self._seen = SeenStamps(round(self.config.radar.restart_after_s * 1e9))
        self._answers = AnswerWatch()
        self._file_is_awaited = False
        self._file_problem = ''
        self._map = self.subscribe(PointCloud2, 'map/descriptors', qos.LATCHED, self._on_map, check=self._check_map)
        self.subscribe(PointCloud2, 'map/updates', qos.UPDATES, self._on_update, ledger=self._update_ledger)
        self.subscribe(PointCloud2, 'map/signatures', qos.RESULTS, self._on_signatures)
        self.subscribe(Odometry, 'odometry', qos.POSITIONS, self._on_odometry)
        self.subscribe(
            PointCloud2, 'embedding', qos.RESULTS, self._on_embedding, ledger=self._ledger, source='encoder_node'
        )

    def configure(self) -> None:
        """Start with an empty map, or with the file that `query.map_path` names."""
        self.stage = QueryStage(self.config.query, self.config.localisation)
        self._file_is_awaited = self.stage.open_file()
        if self._file_is_awaited:
            path = self.config.query.map_path
            self.get_logger().warning(f'query.map_path: {path} does not exist yet: read when it does')

    def activated(self) -> None:
        """Log the size of the map and the threshold."""
        self.get_logger().info(f'active: {self.stage.places} places, rejects U above {self.stage.threshold:.4f}')

    def apply(self, config: Config) -> None:
        """Use the new thresholds, which may change while the node runs."""
        if config == self.config:
            return
        super().apply(config)
        self.stage.reconfigure(config.query)
        self.get_logger().info(f'rejects U above {self.stage.threshold:.4f}')

    def periodic(self) -> None:
        """Report the size of the map, the threshold and the mean of U."""
        if self._file_is_awaited:
            self._read_awaited()
        self._ask_for_signatures()
        self.status.facts |= {
            'places': str(self.stage.places),
            'threshold': f'{self.stage.threshold:.4f}',
            'signatures.missing': str(self.stage.missing_signatures),
        }
        if math.isfinite(self.stage.mean_uncertainty):
            self.status.facts['mean_uncertainty'] = f'{self.stage.mean_uncertainty:.4f}'
        # Without a map, `troubles` says why.
        self.status.warning = self.stage.warning if self.stage.places else ''
        not_aligned = self.stage.not_aligned
        self.status.facts['alignment'] = f'off: {not_aligned}' if not_aligned else 'on'
        if not_localised := self.stage.not_localised:
            self.status.facts['localisation'] = f'off: {not_localised}'

    def troubles(self) -> Iterator[Trouble]:
        """There is no map, or all scans are rejected."""
        if not self.stage.places:
            yield Trouble('no_map', f'no map to search: {self._why_no_map()}')
        elif trouble := self._answers.trouble(self.status.counts):
            yield trouble

    def _read_awaited(self) -> None:
        """Read the file of `query.map_path` once it is there, whole and with a map. A map server sends its own."""
        if self.stage.places or self.count_publishers(self._map.subscription.topic_name):
            self._file_is_awaited = not self.stage.places
            return
        try:
            self._file_is_awaited = self.stage.open_file() or not self.stage.places
            self._file_problem = ''
        except MapError as error:
            # It may be on its way still.
            self._file_problem = str(error)
        if self.stage.places:
            self.get_logger().info(f'map of {self.stage.places} places, from {self.config.query.map_path}')

    def _why_no_map(self) -> str:
        path, name = self.config.query.map_path, self._map.subscription.topic_name
        try:
            if path and status_of(Path(path)) is None:
                return f'query.map_path: {path} does not exist yet'
        except MapError as error:
            return str(error)
        if self._file_problem:
            return self._file_problem
        if not path and not self.count_publishers(name):
            return f'nobody publishes {name}: is map_server_node running, in this domain and namespace?'
        return 'no session with a mapped scan has ended: call map_server/end_session after a drive with positions'

    def _on_map(self, message: PointCloud2) -> None:
        if is_read_the_file(message):
            self.stage.read_file()
        else:
            self._load(self.stage, message)
            self._ask_for_signatures()
        self.get_logger().info(f'map of {self.stage.places} places')

    def _check_map(self, message: PointCloud2) -> None:
        """RefusedInput for a map that can never be searched; its file may be there later."""
        if not is_read_the_file(message):
            self._load(QueryStage(self.config.query), message)

    @staticmethod
    def _load(stage: QueryStage, message: PointCloud2) -> None:
        rows = descriptors_record(message, 'map/descriptors')
        stage.load(rows.table, rows.model, rows.checksums)

    def _on_update(self, message: PointCloud2) -> None:
        rows = descriptors_record(message, 'map/updates')
        self.stage.update(rows.table, rows.model, committed=rows.committed, signatures=rows.signatures)
        self._update_ledger.settle('taken_up')

    def _on_signatures(self, message: PointCloud2) -> None:
        for problem in self.stage.receive_signatures(signatures_record(message, 'map/signatures')):
            self.refuse(problem, 'map/signatures')
        self._ask_for_signatures()

    def _ask_for_signatures(self) -> None:
        """Ask the map server for the next signatures that are missing, unless its last answer is still awaited."""
        if wanted := self.stage.wanted_signatures():
            self._wanted.publish(wanted_message(wanted, self._last_stamp_ns))

    def _on_embedding(self, message: PointCloud2) -> None:
        # Without a stamp there is nothing to answer.
        stamp = self._last_stamp_ns = stamp_ns(message.header.stamp)
        try:
            embedding = embedding_record(message, 'embedding')
        except RefusedInput as problem:
            self.refuse(problem, 'embedding')
            embedding = Embedding(stamp, np.empty(0, np.float32), np.empty(0, np.float32))
        self._seen.check(embedding.stamp_ns, embedding.model)
        outcome = self._outcome(embedding)
        if isinstance(outcome, Match):
            self.status.counts['matched'] += 1
            self._matches.publish(match_message(outcome))
            self._poses.publish(match_pose_message(outcome, self.config.query))
            self._ledger.settle('matched')
        else:
            self.status.counts[f'rejected.{outcome.reason.value}'] += 1
            self._rejections.publish(rejection_message(outcome))
            self._ledger.settle('rejected')
        self.guarded('localisation', partial(self._localise, outcome))

    def _outcome(self, embedding: Embedding) -> Outcome:
        """The answer; also where the search fails, so that no scan waits for one."""
        try:
            return self.stage.query(embedding)
        except Exception as error:
            self.refuse(RefusedInput('internal_error', traceback.format_exc()), 'embedding')
            detail = f'the search failed: {type(error).__name__}'
            return Rejection(embedding.stamp_ns, Reason.INVALID_EMBEDDING, math.nan, self.stage.threshold, (), detail)

    def _localise(self, outcome: Outcome) -> None:
        found = self.stage.localise()
        if found is None:
            return
        config = self.config.query
        if self._initial_poses and (pose := self._initial.pose(outcome, found, config)):
            self._initial_poses.publish(vehicle_pose_message(outcome.stamp_ns, pose, config))
        self.status.facts['localisation'] = found.state.value
        self._localisations.publish(localisation_message(found))
        self._p_on_map.publish(Float64(data=found.p_on_map))
        if found.state is LocalisationState.ON_MAP:
            self._localisation_poses.publish(localisation_pose_message(found))

    def _on_odometry(self, message: Odometry) -> None:
        self.stage.add_odometry(stamp_ns(message.header.stamp), pose_from_odometry(message))

    async def _start_recording(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Answer every stamp again: a recording that is played again has the same.

        Its first scan is to be aligned as its last one is: the answer comes when all signatures of the map have.
        """
        self._seen.reset()
        missing, changed_s = 0, time.monotonic()
        while self.active and self.stage.missing_signatures and time.monotonic() - changed_s < PATIENCE_S:
            if self.stage.missing_signatures != missing:
                missing, changed_s = self.stage.missing_signatures, time.monotonic()
            await self.pause(POLL_S)
        response.success, response.message = True, 'a recording starts with the next scan'
        return response

    def _relocalise(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.active:
            answer = self.stage.relocalise()
            self._initial.ask()
            response.success, response.message = answer.found, answer.detail
        else:
            response.success, response.message = False, 'the node is not active'
        return response


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(QueryNode, args)


if __name__ == '__main__':
    sys.exit(main())
