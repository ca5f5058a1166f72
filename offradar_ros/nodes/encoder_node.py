"""Polar images in, embeddings out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

from offradar_ros.bags.records import scan_from_image, stamp_ns
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.pipeline import EncodeStage
from offradar_ros.ros import navtech, qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.run import run
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.types import PolarScan

SCANS = 'radar_data/b_scan_image'


class EncoderNode(StageNode):
    """Encodes every scan of `radar_data/b_scan_image` to `embedding`, stamped as the scan."""

    stages = ('radar', 'encoder')
    timed_topic = SCANS

    def __init__(self, **options: Any) -> None:
        super().__init__('encoder', **options)
        self._radar = self.config.radar
        self._has_b_scans = False
        self._embeddings = self.publisher(PointCloud2, 'embedding', qos.RESULTS)
        self._model = self.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)
        self.subscribe(Image, SCANS, qos.SCANS, self._on_image)
        types = navtech.message_types()
        if types:
            self.subscribe(types[0], 'radar_data/b_scan_msg', qos.SCANS, self._on_b_scan)
            self.subscribe(types[1], 'radar_data/configuration_data', qos.RESULTS, self._on_configuration)
        self.create_service(Trigger, '~/start_recording', self._start_recording)

    def configure(self) -> None:
        """Load the encoder."""
        self._stage = EncodeStage(make_encoder(self.config.encoder), self.config.radar.restart_after_s)

    def activated(self) -> None:
        """Tell the map and the query which model this is."""
        info = self._stage.encoder.info
        self._model.publish(model_message(info))
        # Encoders without a network know no device.
        device = info.metadata.get('device', 'cpu')
        self.status.facts |= {'model': info.name, 'fingerprint': info.fingerprint, 'dimension': str(info.dimension)}
        self.status.facts['device'] = device
        self.get_logger().info(
            f'active: {info.name}, d = {info.dimension}, {info.fingerprint[:12]}, on {device}, reads {SCANS}'
        )

    def _on_image(self, message: Image) -> None:
        # The same scan comes with its angles on the other topic, stamped by another clock.
        if self._has_b_scans:
            return
        self._encode(message.header, lambda: scan_from_image(message, self._radar))

    def _on_b_scan(self, message: Any) -> None:
        self._has_b_scans = True
        self._encode(message.b_scan_img.header, lambda: navtech.scan_from_b_scan(message, self._radar))

    def _on_configuration(self, message: Any) -> None:
        self._radar = navtech.configured(self.config.radar, message)

    def _start_recording(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.active
        response.message = 'the encoder is not active'
        if self.active:
            self._has_b_scans = False
            self._stage.start_recording()
            response.message = 'a recording starts with the next scan'
        return response

    def _encode(self, header: Any, decode: Callable[[], PolarScan]) -> None:
        encoded = self._stage.encode(stamp_ns(header.stamp), decode)
        if encoded.restarted:
            self.get_logger().info('stamps jumped back: the recording starts again')
        if encoded.embedding is not None:
            self._embeddings.publish(embedding_message(encoded.embedding, header.frame_id))
        if encoded.problem:
            raise encoded.problem


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(EncoderNode, args)


if __name__ == '__main__':
    sys.exit(main())
