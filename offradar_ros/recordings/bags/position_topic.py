"""The topic of a bag whose positions are used, found beside the scans or as a person chose it."""

from __future__ import annotations

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.topics import FIX, FIX_TYPE, ODOMETRY, ODOMETRY_TYPE, absolute

_NAMES = {FIX_TYPE: FIX, ODOMETRY_TYPE: ODOMETRY}


def position_topic(bag: Bag, scans: str, wanted: str = '', msgtype: str = '') -> str | None:
    """The topic with the positions of the topic `scans`: `wanted` if that is given, else one of type `msgtype`.

    Without a type, fixes are taken before odometry. Of several, it is the one that shares the namespace of the scans,
    then the one with the name that the nodes read; None where there is none. DataError, which lists them, where that
    does not decide, or `wanted` is not one of them.
    """
    if wanted:
        return _wanted(bag, absolute(wanted))
    counts = bag.counts
    for kind in (msgtype,) if msgtype else tuple(_NAMES):
        topics = [topic for topic in bag.topics_of(kind) if counts[topic]]
        nearest = max((_shared(topic, scans) for topic in topics), default=0)
        topics = [topic for topic in topics if _shared(topic, scans) == nearest]
        named = [topic for topic in topics if topic.endswith(_NAMES[kind])]
        for candidates in (named, topics):
            if len(candidates) == 1:
                return candidates[0]
        if topics:
            raise DataError(
                f'{bag.path}: several topics may be the positions, choose one with --positions: '
                f'{_listed(bag, topics)}; offradar convert --positions NAME writes a bag of one alone'
            )
    return None


def _wanted(bag: Bag, topic: str) -> str:
    if bag.topics.get(topic) in _NAMES:
        if not bag.counts[topic]:
            raise DataError(f'{bag.path}: --positions {topic}: holds no messages')
        return topic
    is_there = f'is {bag.topics[topic]}' if topic in bag.topics else 'is not in it'
    others = _listed(bag, [other for kind in _NAMES for other in bag.topics_of(kind)])
    raise DataError(
        f'{bag.path}: --positions {topic} {is_there}: expected one of {others or "its positions, and there are none"}'
    )


def _listed(bag: Bag, topics: list[str]) -> str:
    return ', '.join(f'{topic} ({bag.topics[topic]}, {bag.counts[topic]} messages)' for topic in sorted(topics))


def _shared(topic: str, scans: str) -> int:
    """Number of leading parts that two names share."""
    parts = list(zip(topic.strip('/').split('/'), scans.strip('/').split('/'), strict=False))
    return next((index for index, (one, other) in enumerate(parts) if one != other), len(parts))
