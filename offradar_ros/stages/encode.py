"""The first stage: an image in, an embedding out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.stamps import StampGate
from offradar_ros.types import Embedding, PolarScan


@dataclasses.dataclass(frozen=True)
class Encoded:
    """Result of one image.

    Attributes:
        embedding: None only for a repeated scan, which was answered already. Invalid (d = 0) for a scan that cannot be
            encoded or is out of order, so that every scan gets exactly one answer.
        problem: why the scan was refused, or None.
        restarted: whether the stamps jumped back: the recording starts again.
    """

    embedding: Embedding | None
    problem: RefusedInput | None = None
    restarted: bool = False


class EncodeStage:
    """Images in, embeddings out. An invalid scan does not stop the next one."""

    def __init__(self, encoder: Encoder, restart_after_s: float) -> None:
        self.encoder = encoder
        self._gate = StampGate(round(restart_after_s * 1e9))

    def encode(self, stamp_ns: int, decode: Callable[[], PolarScan]) -> Encoded:
        """Embedding of the scan with this stamp that `decode` returns; `decode` may raise RefusedInput."""
        restarted = False
        try:
            restarted = self._gate.check(stamp_ns)
            return Encoded(self.encoder.encode(decode()), restarted=restarted)
        except RefusedInput as problem:
            if problem.cause == 'repeated_stamp':
                return Encoded(None, problem)
            return Encoded(self._invalid(stamp_ns), problem, restarted)

    def start_recording(self) -> None:
        """Accept any stamp for the next scan, which is the first of a recording."""
        self._gate.reset()

    def _invalid(self, stamp_ns: int) -> Embedding:
        nothing = np.empty(0, np.float32)
        return Embedding(stamp_ns, nothing, nothing, self.encoder.info.fingerprint)
