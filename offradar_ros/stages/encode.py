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
    """What became of one image.

    Attributes:
        embedding: None only for the last scan again, which was answered already; invalid (d = 0) for one that cannot
            be encoded or comes out of order, so that every scan gets exactly one answer.
        problem: why the scan was refused, or None.
        restarted: the stamps jumped back: the recording starts again.
    """

    embedding: Embedding | None
    problem: RefusedInput | None = None
    restarted: bool = False


class EncodeStage:
    """Images in, embeddings out; nothing that is wrong with one scan stops the next."""

    def __init__(self, encoder: Encoder, restart_after_s: float) -> None:
        self.encoder = encoder
        self._gate = StampGate(round(restart_after_s * 1e9))

    def encode(self, stamp: int, decode: Callable[[], PolarScan]) -> Encoded:
        """Embedding of the scan that `decode` gives, which may raise RefusedInput."""
        restarted = False
        try:
            restarted = self._gate.check(stamp)
            return Encoded(self.encoder.encode(decode()), restarted=restarted)
        except RefusedInput as problem:
            if problem.cause == 'repeated_stamp':
                return Encoded(None, problem)
            return Encoded(self._invalid(stamp), problem, restarted)

    def start_recording(self) -> None:
        """Take the next scan as the first of a recording, be it the last scan again."""
        self._gate.forget()

    def _invalid(self, stamp: int) -> Embedding:
        nothing = np.empty(0, np.float32)
        return Embedding(stamp, nothing, nothing, self.encoder.info.fingerprint)
