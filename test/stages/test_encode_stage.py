"""The encode stage: each scan gets one answer, also an invalid one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import RefusedInput
from offradar_ros.stages.encode import EncodeStage
from offradar_ros.types import Embedding, PolarScan

SECOND = 10**9
MODEL = ModelInfo('stub', 'ab' * 32, 2, {})


class StubEncoder:
    """Mean and deviation of the power; refuses a scan without power."""

    info = MODEL
    runs_on = 'cpu'

    def encode(self, scan: PolarScan) -> Embedding:
        if not scan.power.any():
            raise RefusedInput('no_signal', 'black')
        mean = np.array([scan.power.mean(), scan.power.std()], np.float32)
        return Embedding(scan.stamp_ns, mean, np.ones(2, np.float32), MODEL.fingerprint)


def scan_of(stamp: int, level: int = 9) -> PolarScan:
    return PolarScan(stamp, np.full((8, 4), level, np.uint8), np.linspace(0.0, math.tau, 8, endpoint=False), 1.0)


Sent = list[tuple[int, str]]


@given(st.lists(st.tuples(st.integers(0, 40), st.sampled_from(['good', 'black', 'unreadable'])), max_size=30))
@settings(max_examples=150, deadline=None)
def test_every_scan_except_a_repeated_one_has_one_answer(sent: Sent) -> None:
    """Stamps in steps of 0.1 s; a jump back of over 1 s starts again."""
    stage = EncodeStage(StubEncoder(), restart_after_s=1.0)
    newest: int | None = None
    for tenths, kind in sent:
        stamp = tenths * SECOND // 10

        def decode(stamp: int = stamp, kind: str = kind) -> PolarScan:
            if kind == 'unreadable':
                raise RefusedInput('wrong_encoding', 'bgr8')
            return scan_of(stamp, 0 if kind == 'black' else 9)

        encoded = stage.encode(stamp, decode)
        if newest is not None and newest - 10 <= tenths <= newest:
            assert (encoded.embedding is None) == (tenths == newest)
            assert encoded.embedding is None or not len(encoded.embedding.mean)
            assert encoded.problem is not None
            assert encoded.problem.cause == ('repeated_stamp' if tenths == newest else 'stamp_backwards')
            continue
        assert encoded.embedding is not None
        assert (encoded.embedding.stamp_ns, encoded.embedding.model) == (stamp, MODEL.fingerprint)
        assert encoded.restarted == (newest is not None and tenths < newest)
        assert len(encoded.embedding.mean) == (2 if kind == 'good' else 0)
        cause = {'good': None, 'black': 'no_signal', 'unreadable': 'wrong_encoding'}[kind]
        assert (encoded.problem and encoded.problem.cause) == cause
        newest = tenths


def test_other_exceptions_pass_through() -> None:
    def decode() -> PolarScan:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        EncodeStage(StubEncoder(), 1.0).encode(1, decode)
