"""Only answers to the scans that were sent are counted, whatever else is on their topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_nodes import Observer, wait_until
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from offradar_ros.ros import qos
from offradar_ros.ros.answer_log import AnswerLog
from offradar_ros.ros.outcome_message import rejection_message
from offradar_ros.ros.stamps import header
from offradar_ros.types import Reason, Rejection

SECOND = 10**9


@pytest.fixture
def observer(domain_id: int) -> Iterator[Observer]:
    observer = Observer(domain_id)
    yield observer
    observer.close()


@pytest.fixture
def log(observer: Observer) -> AnswerLog:
    return AnswerLog(observer.node)


def rejection(stamp_ns: int) -> DiagnosticArray:
    return rejection_message(Rejection(stamp_ns, Reason.MAP_EMPTY, 1.0, 1.5, (), 'empty'))


def test_answers_to_other_scans_are_not_kept(observer: Observer, log: AnswerLog) -> None:
    log.expect(SECOND)
    send = observer.publisher(DiagnosticArray, 'rejections', qos.UPDATES)
    embed = observer.publisher(PointCloud2, 'embedding', qos.UPDATES)
    for number in range(50):
        send(rejection(2 * SECOND + number))
        embed(PointCloud2(header=header(2 * SECOND + number, 'radar')))
    send(rejection(SECOND))
    embed(PointCloud2(header=header(SECOND, 'radar')))
    wait_until(lambda: log.total == 2)
    log.awaited = ('embedding', 'rejections')
    answers = log.answers([SECOND], [])
    assert (answers.embeddings, answers.rejections, answers.reasons) == (1, 1, {'map_empty': 1})


def hostile_rejections() -> list[DiagnosticArray]:
    nested, no_stamp, huge = rejection(SECOND), rejection(SECOND), rejection(SECOND)
    nested.status[0].values[-1].value = '[' * 100_000
    no_stamp.header.stamp.sec = -1
    huge.status[0].values[-1].value = '[{"place_id": 1, "distance": 1' + '0' * 3000 + '}]'
    return [nested, no_stamp, huge]


def test_an_answer_that_is_none_does_not_end_a_replay(observer: Observer, log: AnswerLog) -> None:
    log.expect(SECOND)
    send = observer.publisher(DiagnosticArray, 'rejections', qos.UPDATES)
    embed: Callable[[object], None] = observer.publisher(PointCloud2, 'embedding', qos.UPDATES)
    embed(serialize_message(PointCloud2())[:6])
    for message in hostile_rejections():
        send(message)
    embed(PointCloud2(header=header(SECOND, 'radar')))
    wait_until(lambda: log.total == 3)
    assert log.answers([SECOND], []).reasons == {'wrong_fields': 1}
