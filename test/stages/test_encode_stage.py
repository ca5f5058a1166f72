"""The encode stage: each scan gets one answer, also an invalid one."""

from __future__ import annotations

import dataclasses
import functools
import math
import threading
from typing import NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane import STAMP_NS, TURN_S, make_plane

from offradar_ros.alignment.signature import Signature, SignatureMaker
from offradar_ros.alignment.signature_code import unpack
from offradar_ros.alignment.twist import Twist
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.stamps import KEPT
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
    stage = EncodeStage(StubEncoder(), restart_after_s=1.0, signature=True)
    newest: int | None = None
    answered: set[int] = set()
    for tenths, kind in sent:
        stamp = tenths * SECOND // 10

        def decode(stamp: int = stamp, kind: str = kind) -> PolarScan:
            if kind == 'unreadable':
                raise RefusedInput('wrong_encoding', 'bgr8')
            return scan_of(stamp, 0 if kind == 'black' else 9)

        encoded = stage.encode(stamp, decode)
        if newest is not None and newest - 10 <= tenths <= newest:
            assert (encoded.embedding is None) == (tenths in answered)
            assert encoded.embedding is None or not len(encoded.embedding.mean)
            assert encoded.problem is not None
            assert encoded.problem.cause == ('repeated_stamp' if tenths in answered else 'stamp_backwards')
            answered.add(tenths)
            continue
        assert encoded.embedding is not None
        assert (encoded.embedding.stamp_ns, encoded.embedding.model) == (stamp, MODEL.fingerprint)
        assert encoded.restarted == (newest is not None and tenths < newest)
        assert len(encoded.embedding.mean) == (2 if kind == 'good' else 0)
        cause = {'good': None, 'black': 'no_signal', 'unreadable': 'wrong_encoding'}[kind]
        assert (encoded.problem and encoded.problem.cause) == cause
        if encoded.restarted:
            answered.clear()
        answered.add(tenths)
        newest = tenths


def test_a_scan_is_remembered_for_long_and_not_for_ever() -> None:
    stage = EncodeStage(StubEncoder(), restart_after_s=1e6, signature=True)
    for stamp in range(KEPT + 2):
        stage.encode(stamp, functools.partial(scan_of, stamp))
    problems = [stage.encode(stamp, lambda: scan_of(0)).problem for stamp in (2, 1, KEPT)]
    causes = [problem and problem.cause for problem in problems]
    assert causes == ['repeated_stamp', 'stamp_backwards', 'repeated_stamp']
    stage.start_recording()
    assert stage.encode(KEPT, functools.partial(scan_of, KEPT)).problem is None


def test_topics_may_be_stamped_by_clocks_that_are_apart() -> None:
    stage = EncodeStage(StubEncoder(), 1.0, signature=True)
    for seconds, topic in ((10.0, 'a'), (9.9, 'b'), (10.2, 'a'), (10.1, 'b')):
        stamp = round(seconds * SECOND)
        assert stage.encode(stamp, functools.partial(scan_of, stamp), topic).problem is None
    problem = stage.encode(10 * SECOND, lambda: scan_of(10 * SECOND), 'b').problem
    assert problem is not None
    assert problem.cause == 'stamp_backwards'


def answer_of(encoder: StubEncoder, level: int = 9) -> tuple[int, str]:
    """Width of the embedding, and the cause of the problem; the next scan is encoded all the same."""
    stage = EncodeStage(encoder, 1.0, signature=True)
    encoded = stage.encode(1, lambda: scan_of(1, level))
    assert encoded.embedding is not None
    assert (encoded.embedding.stamp_ns, encoded.embedding.model) == (1, MODEL.fingerprint)
    stage.encoder = StubEncoder()
    following = stage.encode(2, lambda: scan_of(2)).embedding
    assert following is not None
    assert len(following.mean) == 2
    return len(encoded.embedding.mean), encoded.problem.cause if encoded.problem else ''


def test_a_defect_of_a_decoder_is_answered_as_invalid() -> None:
    def decode() -> PolarScan:
        raise ZeroDivisionError

    encoded = EncodeStage(StubEncoder(), 1.0, signature=True).encode(1, decode)
    assert encoded.embedding is not None
    assert len(encoded.embedding.mean) == 0
    assert encoded.problem is not None
    assert encoded.problem.cause == 'internal_error'
    assert 'ZeroDivisionError' in str(encoded.problem)


@pytest.mark.parametrize('error', [RuntimeError('out of\nmemory'), MemoryError(), ValueError('shape'), SystemExit(3)])
def test_a_scan_that_the_encoder_fails_at_is_answered_as_invalid(error: BaseException) -> None:
    class Failing(StubEncoder):
        def encode(self, scan: PolarScan) -> Embedding:
            raise error

    assert answer_of(Failing()) == (0, 'encoder_failed')
    problem = EncodeStage(Failing(), 1.0, signature=True).encode(1, lambda: scan_of(1)).problem
    assert str(problem).startswith(f'stub failed: {type(error).__name__}')
    assert '\n' not in str(problem)


def test_what_no_embedding_can_be_is_answered_as_invalid() -> None:
    class Returning(StubEncoder):
        def __init__(self, returned: object) -> None:
            self.returned = returned

        def encode(self, scan: PolarScan) -> Embedding:
            return self.returned  # type: ignore[return-value]

    def embedding(mean: list[float], variance: list[float], stamp: int = 1, model: str = 'ab' * 32) -> Embedding:
        return Embedding(stamp, np.array(mean, np.float32), np.array(variance, np.float32), model)

    assert answer_of(Returning(embedding([1.0, 2.0], [1.0, 0.0]))) == (2, '')
    for returned in (
        embedding([1.0, math.nan], [1.0, 1.0]),
        embedding([1.0, math.inf], [1.0, 1.0]),
        embedding([1.0, 2.0], [1.0, math.nan]),
        embedding([1.0, 2.0], [1.0, -1.0]),
        embedding([1.0, 2.0, 3.0], [1.0, 1.0, 1.0]),
        embedding([1.0, 2.0], [1.0]),
        embedding([], []),
        embedding([1.0, 2.0], [1.0, 1.0], stamp=2),
        embedding([1.0, 2.0], [1.0, 1.0], model='cd' * 32),
        Embedding(1, np.ones((2, 1), np.float32), np.ones((2, 1), np.float32), MODEL.fingerprint),
        None,
    ):
        assert answer_of(Returning(returned)) == (0, 'invalid_output')


def test_the_faults_of_a_scan_s_rows_are_passed_on() -> None:
    scan = dataclasses.replace(scan_of(1), row_faults={'saturated': 3})
    assert EncodeStage(StubEncoder(), 1.0, signature=True).encode(1, lambda: scan).row_faults == {'saturated': 3}


def test_each_embedding_carries_the_signature_of_its_scan() -> None:
    """Of a scan with a wall ahead, and none at the sides."""
    power = np.full((40, 100), 20, np.uint8)
    power[:5, 40:43] = 200
    scan = PolarScan(1, power, np.linspace(0.0, math.tau, 40, endpoint=False), 1.0)
    encoded = EncodeStage(StubEncoder(), 1.0, signature=True).encode(1, lambda: scan)
    assert encoded.embedding is not None
    assert encoded.no_signature == ''
    found = unpack(encoded.embedding.signature)
    np.testing.assert_array_equal(found.image, SignatureMaker()(scan).image)
    assert found.image[:20, 41].all() and not found.image[40:190, 41].any()


def test_a_signature_is_made_while_the_encoder_works(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, make = threading.Event(), SignatureMaker.__call__

    class Waiting(StubEncoder):
        def encode(self, scan: PolarScan) -> Embedding:
            assert begun.wait(10.0)
            return super().encode(scan)

    def noted(maker: SignatureMaker, scan: PolarScan) -> Signature:
        begun.set()
        return make(maker, scan)

    monkeypatch.setattr(SignatureMaker, '__call__', noted)
    encoded = EncodeStage(Waiting(), 1.0, signature=True).encode(1, lambda: scan_of(1))
    assert encoded.problem is None


def test_signatures_can_be_switched_off() -> None:
    encoded = EncodeStage(StubEncoder(), 1.0, signature=False).encode(1, lambda: scan_of(1))
    assert encoded.embedding is not None
    assert (encoded.embedding.signature, encoded.no_signature) == (b'', '')


def test_an_encoder_s_own_idea_of_a_signature_does_not_count() -> None:
    class Signing(StubEncoder):
        def encode(self, scan: PolarScan) -> Embedding:
            return dataclasses.replace(super().encode(scan), signature=b'anything')

    for signature in (True, False):
        encoded = EncodeStage(Signing(), 1.0, signature=signature).encode(1, lambda: scan_of(1))
        assert encoded.embedding is not None
        assert encoded.embedding.signature != b'anything'


def test_a_scan_without_an_embedding_has_no_signature() -> None:
    encoded = EncodeStage(StubEncoder(), 1.0, signature=True).encode(1, lambda: scan_of(1, 0))
    assert encoded.embedding is not None
    assert (len(encoded.embedding.mean), encoded.embedding.signature, encoded.no_signature) == (0, b'', '')


def test_where_no_signature_can_be_made_the_embedding_goes_without(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = EncodeStage(StubEncoder(), 1.0, signature=True)
    expected = stage.encode(1, lambda: scan_of(1)).embedding

    def fail(*_: object) -> NoReturn:
        raise ValueError('two\nlines')

    with monkeypatch.context() as patch:
        patch.setattr(SignatureMaker, '__call__', fail)
        encoded = stage.encode(2, lambda: scan_of(2))
    assert encoded.embedding is not None and expected is not None
    assert encoded.problem is None
    assert encoded.no_signature == 'ValueError: two lines'
    assert (encoded.embedding.mean.tolist(), encoded.embedding.signature) == (expected.mean.tolist(), b'')
    again = stage.encode(3, lambda: scan_of(3)).embedding
    assert again is not None and again.signature


def driven(number: int) -> PolarScan:
    """A scan of a vehicle that drives 2 m a turn, the `number`-th one."""
    scan = make_plane(1).scan((2.0 * number, 0.0, 0.0), twist=Twist(2.0 / TURN_S), seed=abs(number))
    stamp_ns = STAMP_NS + round(number * TURN_S * 1e9)
    assert scan.azimuth_stamps_ns is not None
    rows_ns = scan.azimuth_stamps_ns + (stamp_ns - STAMP_NS)
    return dataclasses.replace(scan, stamp_ns=stamp_ns, azimuth_stamps_ns=rows_ns)


def test_a_signature_has_the_velocity_of_its_vehicle_from_the_second_scan_on() -> None:
    stage = EncodeStage(StubEncoder(), 1.0, signature=True)

    def velocities(numbers: range) -> list[Twist | None]:
        found = []
        for scan in map(driven, numbers):
            encoded = stage.encode(scan.stamp_ns, functools.partial(dataclasses.replace, scan))
            assert encoded.embedding is not None
            found.append(unpack(encoded.embedding.signature).twist)
        return found

    first, *others = velocities(range(4))
    assert first is None
    for other in others:
        assert other is not None
        assert other.forward_mps == pytest.approx(8.0, abs=0.5)
    # Stamps that jump back start another recording, and so does who says so, whatever the stamps.
    assert velocities(range(-8, -6))[0] is None
    stage.start_recording()
    assert velocities(range(-6, -5)) == [None]


def test_a_scan_that_the_encoder_refuses_says_nothing_of_the_velocity() -> None:
    class Refusing(StubEncoder):
        def encode(self, scan: PolarScan) -> Embedding:
            if scan.stamp_ns == driven(2).stamp_ns:
                raise RefusedInput('no_signal', 'not within the image')
            return super().encode(scan)

    def signatures(numbers: tuple[int, ...]) -> list[bytes]:
        stage, found = EncodeStage(Refusing(), 1.0, signature=True), []
        for scan in map(driven, numbers):
            encoded = stage.encode(scan.stamp_ns, functools.partial(dataclasses.replace, scan))
            assert encoded.embedding is not None
            found.append(encoded.embedding.signature)
        return found

    *before, refused, after = signatures((0, 1, 2, 3))
    assert refused == b''
    assert [*before, after] == signatures((0, 1, 3))


def test_without_stamps_of_rows_there_is_no_velocity() -> None:
    """Nothing could be straightened with it."""
    stage = EncodeStage(StubEncoder(), 1.0, signature=True)
    for number in range(3):
        scan = dataclasses.replace(make_plane(1).scan(), azimuth_stamps_ns=None)
        encoded = stage.encode(
            number * SECOND // 4, functools.partial(dataclasses.replace, scan, stamp_ns=number * SECOND // 4)
        )
        assert encoded.embedding is not None
        assert unpack(encoded.embedding.signature).twist is None
