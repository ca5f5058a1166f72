"""The topic of a bag that holds the polar scans, found by what its first messages hold, or as a person chose it."""

from __future__ import annotations

import enum
import itertools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.messages import scan_from_compressed, scan_from_image
from offradar_ros.radar.profiles import PROFILES
from offradar_ros.recordings.bags.reader import Bag, RawMessage
from offradar_ros.recordings.bags.topics import COMPRESSED, COMPRESSED_TYPE, IMAGE_TYPE, absolute
from offradar_ros.types import PolarScan

DECODERS: dict[str, Callable[[Any, RadarConfig], PolarScan]] = {
    IMAGE_TYPE: scan_from_image,
    COMPRESSED_TYPE: scan_from_compressed,
}
"""The scan in a message, by the type of the message."""

_LOOKED_AT = 3
_NAMES = ('b_scan_image', 'radar/polar', 'Navtech/Polar')
_NO_SCAN = ('wrong_encoding', 'lossy_image', 'image_too_large', 'empty_image')
"""Causes for which a message is no polar scan, however the radar is configured."""


class Fit(enum.IntEnum):
    """How surely a topic holds polar scans."""

    EMPTY = 0
    NOT = 1
    """Colour, JPEG or damaged."""
    GRAY = 2
    """8-bit gray, of a size that no known radar has."""
    POLAR = 3
    """8-bit gray with the 11 metadata columns, or of the size that a known radar has."""


class ImageTopic(NamedTuple):
    """A topic of images.

    Attributes:
        name: its name.
        msgtype: Image or CompressedImage.
        messages: how many it has.
        content: encoding and size of the first message.
        fit: how surely it holds polar scans.
        reason: why its first message is not read as one, or empty.
    """

    name: str
    msgtype: str
    messages: int
    content: str
    fit: Fit
    reason: str

    def __str__(self) -> str:
        held = f', {self.content}' if self.content else ''
        return f'{self.name} ({self.msgtype}{held}, {self.messages} messages)'


def scan_topic(bag: Bag, radar: RadarConfig | None = None, wanted: str = '') -> str:
    """The topic of the polar scans, `wanted` if that is given.

    DataError where the bag holds no scans, or several topics that may be scans; it lists them.
    """
    found = image_topics(bag, radar or RadarConfig())
    if wanted:
        return _wanted(bag, found, absolute(wanted))
    if not found:
        held = ', '.join(f'{topic} ({kind})' for topic, kind in bag.topics.items()) or 'no topic at all'
        raise DataError(f'{bag.path}: no scans: expected a topic of {IMAGE_TYPE} or {COMPRESSED_TYPE}, found {held}')
    if all(topic.fit == Fit.EMPTY for topic in found):
        names = ', '.join(topic.name for topic in found)
        raise DataError(f'{bag.path}: no scans: topic {names} holds no messages')
    gray = _without_copies([topic for topic in found if topic.fit >= Fit.GRAY])
    named = [topic for topic in gray if topic.name.removesuffix(COMPRESSED).endswith(_NAMES)]
    polar = [topic for topic in gray if topic.fit == Fit.POLAR]
    candidates = named or polar or gray
    if len(candidates) == 1:
        return candidates[0].name
    if candidates:
        raise DataError(
            f'{bag.path}: several topics may be the scans, choose one with --topic: {_listed(candidates)}; '
            'offradar convert --topic NAME writes a bag of one alone'
        )
    held = ', '.join(f'{topic}: {topic.reason}' for topic in found if topic.fit == Fit.NOT)
    raise DataError(f'{bag.path}: no scans: expected polar images of 8-bit gray, found {held}')


def image_topics(bag: Bag, radar: RadarConfig) -> list[ImageTopic]:
    """Every topic of images of a bag, as its first messages are."""
    return [_described(bag, topic, radar) for topic in sorted(bag.topics) if bag.topics[topic] in DECODERS]


def decoded_scan(bag: Bag, raw: RawMessage, radar: RadarConfig) -> PolarScan:
    """The scan in a message; RefusedInput says what is wrong with it."""
    return DECODERS[raw.msgtype](bag.decode(raw), radar)


def _wanted(bag: Bag, found: list[ImageTopic], name: str) -> str:
    topic = next((topic for topic in found if topic.name == name), None)
    if topic is None:
        is_there = f'is {bag.topics[name]}' if name in bag.topics else 'is not in it'
        others = _listed(found) or 'its images, and there are none'
        raise DataError(f'{bag.path}: --topic {name} {is_there}: expected one of {others}')
    if topic.fit == Fit.EMPTY:
        raise DataError(f'{bag.path}: no scans: topic {name} holds no messages')
    if topic.fit == Fit.NOT:
        raise DataError(f'{bag.path}: --topic {topic} holds no polar scans: {topic.reason}')
    return topic.name


def _listed(topics: Iterable[ImageTopic]) -> str:
    return ', '.join(map(str, topics))


def _without_copies(topics: list[ImageTopic]) -> list[ImageTopic]:
    """Without the compressed ones of images that are there too."""
    names = {topic.name for topic in topics}
    return [topic for topic in topics if topic.name.removesuffix(COMPRESSED) not in names - {topic.name}]


def _described(bag: Bag, topic: str, radar: RadarConfig) -> ImageTopic:
    msgtype = bag.topics[topic]
    content, fit, reason = '', Fit.EMPTY, ''
    for raw in itertools.islice(bag.messages([topic]), _LOOKED_AT):
        try:
            message = bag.decode(raw)
        except DataError as error:
            # Whoever reads the whole topic says so.
            fit, reason = max(fit, Fit.GRAY), reason or str(error)
            continue
        content = content or _content(message)
        looked, why = _fit(message, msgtype, radar)
        if looked > fit:
            fit, reason = looked, why
    return ImageTopic(topic, msgtype, bag.counts[topic], content, fit, reason)


def _fit(message: Any, msgtype: str, radar: RadarConfig) -> tuple[Fit, str]:
    try:
        scan = DECODERS[msgtype](message, radar)
    except RefusedInput as refusal:
        return (Fit.NOT if refusal.cause in _NO_SCAN else Fit.GRAY), str(refusal)
    rows, bins = scan.power.shape
    is_known = bins in {profile.range_bins for profile in PROFILES.values()} and rows <= radar.azimuth_samples
    is_turn = rows == radar.azimuth_samples != bins
    polar = scan.azimuth_stamps_ns is not None or is_known or is_turn
    return (Fit.POLAR if polar else Fit.GRAY), ''


def _content(message: Any) -> str:
    if hasattr(message, 'format'):
        return str(message.format)[:80].strip()
    return f'{str(message.encoding)[:80]} {message.height} × {message.width}'
