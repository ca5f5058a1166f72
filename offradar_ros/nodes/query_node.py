"""Embeddings in, a match or a reasoned rejection out."""

from __future__ import annotations

import collections
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2

from offradar_ros.config import Config
from offradar_ros.errors import RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.retrieval.mean_storage import widens_halves_quickly
from offradar_ros.ros import qos
from offradar_ros.ros.diagnostics import WINDOW
from offradar_ros.ros.embedding_message import embedding_record
from offradar_ros.ros.outcome_message import match_message, match_pose_message, rejection_message
from offradar_ros.ros.place_message import descriptors_record, says_read_the_file
from offradar_ros.ros.run import run
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.types import Embedding, Match


class QueryNode(StageNode):
    """Answers each embedding exactly once, on `matches` (and `match_pose`) or on `rejections`."""

    stages = ('query',)
    timed_topic = 'embedding'

    def __init__(self, **options: Any) -> None:
        super().__init__('query', **options)
        self._query = IntrospectiveQuery(self.config.query)
        self._uncertainties: collections.deque[float] = collections.deque(maxlen=WINDOW)
        self._matches = self.publisher(PointCloud2, 'matches', qos.RESULTS)
        self._poses = self.publisher(PoseWithCovarianceStamped, 'match_pose', qos.RESULTS)
        self._rejections = self.publisher(DiagnosticArray, 'rejections', qos.RESULTS)
        self.subscribe(PointCloud2, 'map/descriptors', qos.LATCHED, self._on_map)
        self.subscribe(PointCloud2, 'map/updates', qos.UPDATES, self._on_update)
        self.subscribe(PointCloud2, 'embedding', qos.RESULTS, self._on_embedding)

    def configure(self) -> None:
        """Start with an empty map, or with the file that `query.map_path` names."""
        self._query = IntrospectiveQuery(self.config.query)
        if self.config.query.storage == 'float16' and not widens_halves_quickly():
            self.get_logger().warning('query.storage: float16 is searched several times slower without llvmlite')
        path = Path(self.config.query.map_path)
        if not self.config.query.map_path:
            return
        if path.exists() or not path.parent.is_dir():
            self._read_file()
        else:
            self.get_logger().warning(f'query.map_path: {path} is not there yet: waiting for the map server')

    def activated(self) -> None:
        """Say what is searched."""
        self.get_logger().info(f'active: {self._query.places} places, rejects U above {self._query.threshold:.4f}')

    def apply(self, config: Config) -> None:
        """Thresholds may change while the node runs."""
        if config == self.config:
            return
        super().apply(config)
        self._query.reconfigure(config.query)
        self.get_logger().info(f'rejects U above {self._query.threshold:.4f}')

    def periodic(self) -> None:
        """Say what is searched, and with which threshold."""
        self.status.facts |= {'places': str(self._query.places), 'threshold': f'{self._query.threshold:.4f}'}
        if self._uncertainties:
            mean = float(np.mean(self._uncertainties))
            self.status.facts['mean_uncertainty'] = f'{mean:.4f}'
            drifted = abs(mean - 1.0) > self.config.query.delta
            self.status.warning = f'mean U {mean:.2f} is not near 1: calibrate for this sensor' if drifted else ''
        if not self._query.places:
            self.status.warning = 'no map to search'

    def _on_map(self, message: PointCloud2) -> None:
        if says_read_the_file(message):
            if not self.config.query.map_path:
                raise RefusedInput(
                    'map_too_large',
                    'the map is too large for a message: set query.map_path to the file of the map server',
                )
            self._read_file()
        else:
            rows = descriptors_record(message, 'map/descriptors')
            self._query.load(rows.table, rows.model)
        self.get_logger().info(f'map of {self._query.places} places')

    def _read_file(self) -> None:
        self._query.load_file(Path(self.config.query.map_path))

    def _on_update(self, message: PointCloud2) -> None:
        if message.width:
            rows = descriptors_record(message, 'map/updates')
            self._query.update(rows.table, rows.model, committed=rows.committed)

    def _on_embedding(self, message: PointCloud2) -> None:
        try:
            embedding = embedding_record(message, 'embedding')
        except RefusedInput as problem:
            self.refuse(problem, 'embedding')
            embedding = Embedding(stamp_ns(message.header.stamp), np.empty(0, np.float32), np.empty(0, np.float32))
        outcome = self._query.query(embedding)
        if math.isfinite(outcome.uncertainty):
            self._uncertainties.append(outcome.uncertainty)
        if isinstance(outcome, Match):
            self.status.counts['matched'] += 1
            self._matches.publish(match_message(outcome))
            self._poses.publish(match_pose_message(outcome, self.config.query.position_sigma_m))
        else:
            self.status.counts[f'rejected.{outcome.reason.value}'] += 1
            self._rejections.publish(rejection_message(outcome))


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(QueryNode, args)


if __name__ == '__main__':
    sys.exit(main())
