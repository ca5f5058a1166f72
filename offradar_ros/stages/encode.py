"""The first stage: an image in, an embedding out."""

from __future__ import annotations

import copy
import dataclasses
import traceback
from collections import defaultdict
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from offradar_ros.alignment.scan_odometry import ScanOdometry
from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.signature_code import pack
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.stamps import StampGate
from offradar_ros.types import Embedding, PolarScan


@dataclasses.dataclass(frozen=True)
class Encoded:
    """Result of one image.

    Attributes:
        embedding: None only for a scan that was answered already. Invalid (d = 0) for a scan that cannot be
            encoded or is out of order, so that every scan gets exactly one answer.
        problem: why the scan was refused, or None.
        no_signature: why the embedding has no signature though it should have one; empty otherwise.
        restarted: whether the stamps jumped back: the recording starts again.
        row_faults: those of the scan (`PolarScan.row_faults`).
    """

    embedding: Embedding | None
    problem: RefusedInput | None = None
    no_signature: str = ''
    restarted: bool = False
    row_faults: Mapping[str, int] = dataclasses.field(default_factory=dict)


class _Signed(NamedTuple):
    """The packed signature of a scan, empty for none, why there is none, and the odometry after the scan."""

    signature: bytes
    problem: str
    odometry: ScanOdometry


class EncodeStage:
    """Images in, embeddings out. Neither an invalid scan nor an encoder that fails stops the next one.

    With `signature`, each embedding carries that of its scan, with the velocity of the vehicle where its rows have
    stamps. Where none can be made, it goes without. It is made in a thread of its own, while the encoder works.
    """

    def __init__(self, encoder: Encoder, restart_after_s: float, *, signature: bool) -> None:
        self.encoder = encoder
        self._make_signature = SignatureMaker() if signature else None
        self._odometry = ScanOdometry()
        self._beside = ThreadPoolExecutor(1, 'signature')
        self._gates = defaultdict[str, StampGate](lambda: StampGate(round(restart_after_s * 1e9)))

    def encode(self, stamp_ns: int, decode: Callable[[], PolarScan], topic: str = '') -> Encoded:
        """Embedding of the scan with this stamp that `decode` returns; nothing is raised, whatever `decode` raises.

        A stamp is compared with those of the same topic: another one may be stamped by another clock.

        Besides those of the scan, the cause of a problem may be encoder_failed (it raised an exception),
        invalid_output (an embedding of another shape, stamp or model, or that is not finite) or internal_error.
        """
        restarted = False
        try:
            restarted = self._gates[topic].check(stamp_ns)
            scan = decode()
            signing = self._beside.submit(self._signed, scan)
            try:
                embedding = self._embedding(scan, stamp_ns)
            finally:
                signed = signing.result()
            # Not of a scan that the encoder refuses: the next one is not compared with it.
            self._odometry = signed.odometry
            embedding = dataclasses.replace(embedding, signature=signed.signature)
            return Encoded(embedding, None, signed.problem, restarted, scan.row_faults)
        except RefusedInput as problem:
            if problem.cause == 'repeated_stamp':
                return Encoded(None, problem)
            return Encoded(self._invalid(stamp_ns), problem, restarted=restarted)
        except Exception:
            defect = RefusedInput('internal_error', traceback.format_exc())
            return Encoded(self._invalid(stamp_ns), defect, restarted=restarted)

    def start_recording(self) -> None:
        """Accept any stamp for the next scan, which is the first of a recording."""
        self._gates.clear()
        self._odometry.restart()

    def _embedding(self, scan: PolarScan, stamp_ns: int) -> Embedding:
        """RefusedInput unless the encoder returns an embedding of this scan that can be compared."""
        info = self.encoder.info
        try:
            embedding = self.encoder.encode(scan)
        except RefusedInput:
            raise
        except (Exception, SystemExit) as error:
            # An encoder of another package may even try to exit.
            raise RefusedInput('encoder_failed', f'{info.name} failed: {_in_one_line(error)}') from error
        if not isinstance(embedding, Embedding):
            raise RefusedInput('invalid_output', f'{info.name} returned {type(embedding).__name__}: expected Embedding')
        found = (embedding.stamp_ns, embedding.model, embedding.mean.shape, embedding.variance.shape)
        expected = (stamp_ns, info.fingerprint, (info.dimension,), (info.dimension,))
        if found != expected:
            raise RefusedInput(
                'invalid_output', f'{info.name} returned stamp, model and shapes {found}: expected {expected}'
            )
        if not (np.isfinite(embedding.mean).all() and np.isfinite(embedding.variance).all()):
            raise RefusedInput('invalid_output', f'{info.name} returned values that are not finite')
        if (embedding.variance < 0.0).any():
            raise RefusedInput('invalid_output', f'{info.name} returned a variance below zero')
        return embedding

    def _signed(self, scan: PolarScan) -> _Signed:
        if self._make_signature is None:
            return _Signed(b'', '', self._odometry)
        odometry = copy.copy(self._odometry)
        try:
            signature = self._make_signature(scan)
            twist = odometry.twist(signature, scan.stamp_ns)
            return _Signed(pack(dataclasses.replace(signature, twist=twist)), '', odometry)
        except Exception as error:
            return _Signed(b'', _in_one_line(error), odometry)

    def _invalid(self, stamp_ns: int) -> Embedding:
        nothing = np.empty(0, np.float32)
        return Embedding(stamp_ns, nothing, nothing, self.encoder.info.fingerprint)


def _in_one_line(error: BaseException) -> str:
    return f'{type(error).__name__}: {" ".join(str(error).split())}'
