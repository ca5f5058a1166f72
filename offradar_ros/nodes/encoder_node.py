"""Polar images in, embeddings out.

A callback only queues each scan; a worker decodes, encodes and publishes. So no scan waits for more than the one in
progress and `encoder.backlog` others. ONNX Runtime and NumPy release the interpreter's lock while they compute.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_srvs.srv import Trigger

from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.messages import scan_from_compressed, scan_from_image, stamp_ns
from offradar_ros.ros import navtech, qos
from offradar_ros.ros.diagnostics import Trouble
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.ledger import Ledger
from offradar_ros.ros.newest_worker import NewestWorker
from offradar_ros.ros.run import run
from offradar_ros.ros.stage_node import StageNode
from offradar_ros.stages.encode import EncodeStage
from offradar_ros.types import PolarScan

SCANS = 'radar_data/b_scan_image'
COMPRESSED_SCANS = f'{SCANS}/compressed'
B_SCANS = 'radar_data/b_scan_msg'
PARTIAL_SCANS = 10
"""So many scans in a row that are no whole rotation are worth a word."""
RECENT_S = 10.0
"""A signature that could not be made at most this long ago says how things are."""
SLOW_S = 10.0
"""A scan that takes longer than this is reported while it does."""


@dataclasses.dataclass(frozen=True)
class Received:
    """A scan message that was received.

    Attributes:
        topic: the topic that it was received on.
        header: its std_msgs/Header.
        decode: returns the scan in it, or raises RefusedInput.
        recording: number of recordings that were announced before it.
        received_s: time of reception by the steady clock.
    """

    topic: str
    header: Any
    decode: Callable[[], PolarScan]
    recording: int
    received_s: float


class EncoderNode(StageNode):
    """Encodes the scans of `radar_data/b_scan_image` to `embedding`, stamped as the scan.

    Each is answered, but for those dropped because more came than can be encoded (`overtaken`): the newest goes first.
    Every one that was sent is counted: see `Ledger`.
    """

    parameter_groups = ('radar', 'encoder')
    stage: EncodeStage

    def __init__(self, **options: Any) -> None:
        super().__init__('encoder', **options)
        self._radar = self.config.radar
        # Whether the last scan of that topic could be encoded.
        self._b_scan_is_sound = False
        self._recording = self._encoded_recording = 0
        self._partial = 0
        self._no_signature, self._no_signature_s = '', -math.inf
        self._worker: NewestWorker[Received] | None = None
        self._ledger = Ledger('scans')
        self._embeddings = self.publisher(PointCloud2, 'embedding', qos.RESULTS)
        self._model = self.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)
        if self.config.radar.transport == 'raw':
            self._input, kind, handle = SCANS, Image, self._on_image
            other = {
                'sensor_msgs/msg/CompressedImage': f'set radar.transport: compressed, and remap {COMPRESSED_SCANS}'
            }
        else:
            self._input, kind, handle = COMPRESSED_SCANS, CompressedImage, self._on_compressed
            other = {'sensor_msgs/msg/Image': f'set radar.transport: raw, and remap {SCANS}'}
        self._scans = self.subscribe(
            kind, self._input, qos.SCANS, handle, ledger=self._ledger, source="the radar's driver", instead=other
        )
        types = navtech.message_types()
        if types:
            self._b_scans = self.subscribe(types[0], B_SCANS, qos.SCANS, self._on_b_scan, ledger=self._ledger)
            self.subscribe(types[1], 'radar_data/configuration_data', qos.RESULTS, self._on_configuration)
        self.create_service(Trigger, '~/start_recording', self._start_recording)

    def configure(self) -> None:
        """Load the encoder."""
        self.close()
        self.stage = EncodeStage(
            make_encoder(self.config.encoder),
            self.config.radar.restart_after_s,
            signature=self.config.encoder.signature,
        )
        self._worker = NewestWorker(self._answer, self._overtaken, self.config.encoder.backlog)

    def activated(self) -> None:
        """Publish the model for the map server and the query node."""
        info = self.stage.encoder.info
        self._model.publish(model_message(info))
        device = self.stage.encoder.runs_on
        self.status.facts |= {'model': info.name, 'fingerprint': info.fingerprint, 'dimension': str(info.dimension)}
        self.status.facts['device'] = device
        self.get_logger().info(
            f'active: {info.name}, d = {info.dimension}, {info.fingerprint[:12]}, on {device}, reads {self._input}'
        )

    def deactivating(self) -> None:
        """Answer the scan in progress, and forget the scans that wait: they are counted as `inactive`."""
        if self._worker:
            self._settle(self._worker.forget())

    def close(self) -> None:
        """End the worker after the scan in progress; scans that wait are counted as `inactive`."""
        if self._worker:
            self._settle(self._worker.stop())

    def periodic(self) -> None:
        """Report a scan that takes long."""
        busy_s = self._worker.busy_s if self._worker else 0.0
        self.status.warning = ''
        if busy_s > SLOW_S:
            self.status.warning = f'one scan has been encoded for {busy_s:.0f} s: the encoder hangs or is far too slow'

    def troubles(self) -> Iterator[Trouble]:
        """All scans are smaller than a rotation, or of some no signature can be made."""
        if self._partial >= PARTIAL_SCANS:
            yield Trouble(
                'partial_scans',
                f'the last {self._partial} scans had fewer rows than radar.azimuth_samples = '
                f'{self._radar.azimuth_samples}, and are taken for the first part of a turn: set it to the number of '
                'rows of a rotation, or see why the driver cuts them off',
            )
        if time.monotonic() - self._no_signature_s < RECENT_S:
            yield Trouble(
                'no_signature',
                f'scans are encoded, but go without a signature, so that no match is aligned: {self._no_signature}: '
                'report it, and set encoder.signature to false until then',
            )

    def _settle(self, forgotten: list[Received]) -> None:
        for _ in forgotten:
            self._ledger.settle('inactive')

    def destroy_node(self) -> None:
        """Also end the worker: a process that composes nodes and only destroys them would never exit otherwise."""
        self.close()
        super().destroy_node()

    def _on_image(self, message: Image) -> None:
        if self._comes_as_b_scan():
            self._ledger.settle('on_other_topic')
        else:
            self._receive(SCANS, message.header, functools.partial(scan_from_image, message, self._radar))

    def _on_compressed(self, message: CompressedImage) -> None:
        if self._comes_as_b_scan():
            self._ledger.settle('on_other_topic')
        else:
            decode = functools.partial(scan_from_compressed, message, self._radar)
            self._receive(COMPRESSED_SCANS, message.header, decode)

    def _comes_as_b_scan(self) -> bool:
        """Whether the driver also sends a scan on the other topic, with its angles and a stamp of another clock."""
        return self._b_scan_is_sound and not self._b_scans.watch.is_silent

    def _on_b_scan(self, message: Any) -> None:
        self._scans.watch.received()
        header = message.b_scan_img.header
        self._receive(B_SCANS, header, functools.partial(navtech.scan_from_b_scan, message, self._radar))

    def _receive(self, topic: str, header: Any, decode: Callable[[], PolarScan]) -> None:
        scan = Received(topic, header, decode, self._recording, time.monotonic())
        if not (self._worker and self._worker.put(scan)):
            self._ledger.settle('inactive')

    def _on_configuration(self, message: Any) -> None:
        self._radar = navtech.configured(self.config.radar, message)

    def _start_recording(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the next scan as the first of a recording, with any stamp.

        Stamps alone do not show it: a recording that is shorter than `radar.restart_after_s` and played again looks
        like scans that were sent twice or late, which are refused. The player knows, and calls this service.
        """
        response.success = self.active
        response.message = 'the encoder is not active'
        if self.active:
            self._b_scan_is_sound = False
            # Scans that still wait belong to the recording before.
            self._recording += 1
            response.message = 'a recording starts with the next scan'
        return response

    def _overtaken(self, scan: Received) -> None:
        problem = 'scans arrive faster than they are encoded: the newest go first'
        self._ledger.settle('overtaken')
        self.refuse(RefusedInput('overtaken', problem), scan.topic)

    def _answer(self, scan: Received) -> None:
        encoded = self.guarded(scan.topic, functools.partial(self._encode, scan))
        if scan.topic == B_SCANS:
            self._b_scan_is_sound = encoded
        if encoded:
            self._ledger.settle('encoded')
            self.status.handle(scan.received_s)
        else:
            self._ledger.settle('refused')

    def _encode(self, scan: Received) -> None:
        if scan.recording != self._encoded_recording:
            self._encoded_recording = scan.recording
            self.stage.start_recording()
        encoded = self.stage.encode(stamp_ns(scan.header.stamp), scan.decode, scan.topic)
        if encoded.restarted:
            self.status.counts['recordings.restarted'] += 1
            self.log_now_and_then('stamps jumped back: the recording starts again')
        self._partial = self._partial + 1 if 'missing' in encoded.row_faults else 0
        for fault, count in encoded.row_faults.items():
            self.status.counts[f'rows.{fault}'] += count
        if encoded.no_signature:
            self._no_signature, self._no_signature_s = encoded.no_signature, time.monotonic()
            self.status.counts['signatures.failed'] += 1
        if encoded.embedding is not None:
            self._embeddings.publish(embedding_message(encoded.embedding, scan.header.frame_id))
        if encoded.problem:
            raise encoded.problem


def main(args: list[str] | None = None) -> int:
    """Entry point."""
    return run(EncoderNode, args)


if __name__ == '__main__':
    sys.exit(main())
