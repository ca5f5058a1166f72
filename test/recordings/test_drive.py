"""A drive through the stages, compared with slow loops: each scan is answered once, also among bad messages."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from outcome_key import key
from recorded_topics import header
from rosbags.rosbag2 import StoragePlugin, Writer

from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.config import Config, RadarConfig, load_config
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, scan_from_image, stamp_ns
from offradar_ros.recordings.bags.reader import TYPES, Bag, RawMessage
from offradar_ros.recordings.bags.topics import FIX, IMAGE_TYPE, SCANS
from offradar_ros.recordings.drive import drive, in_lockstep_order
from offradar_ros.stages.encode import EncodeStage
from offradar_ros.stages.map import MapStage, MapUpdate
from offradar_ros.types import Embedding, Match, Outcome, Reason, Rejection, ScanKey

SECOND = 10**9
MODEL = ModelInfo('stub', 'ab' * 32, 2, {})


# in_lockstep_order


class Recording:
    """The part of a bag that `in_lockstep_order` uses."""

    def __init__(self, **topics: list[int]) -> None:
        self.recorded = [RawMessage(topic, '', log, b'') for topic, logs in topics.items() for log in sorted(logs)]

    def messages(self, topics: Sequence[str]) -> Iterator[RawMessage]:
        return iter(sorted((m for m in self.recorded if m.topic in topics), key=lambda m: m.log_ns))


logs = st.lists(st.integers(0, 40), max_size=12)


@given(logs, logs, logs, st.integers(0, 5))
@settings(max_examples=100, deadline=None)
def test_each_scan_comes_after_all_up_to_a_little_later_and_nothing_more(
    scans: list[int], fixes: list[int], imu: list[int], ahead: int
) -> None:
    bag: Any = Recording(scan=scans, fix=fixes, imu=imu)
    found = list(in_lockstep_order(bag, 'scan', ['fix', 'imu'], ahead / SECOND))
    assert Counter(found) == Counter(bag.recorded)
    for topic, sent in (('scan', scans), ('fix', fixes), ('imu', imu)):
        assert [m.log_ns for m in found if m.topic == topic] == sorted(sent)
    for index, message in enumerate(found):
        if message.topic == 'scan':
            before = [m.log_ns for m in found[:index] if m.topic != 'scan']
            assert sorted(before) == sorted(log for log in fixes + imu if log <= message.log_ns + ahead)


# drive


def write_messages(path: Path, messages: Sequence[tuple[str, str, int, Any]]) -> Path:
    """A bag of (topic, type, log time, message)."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in {m[:2] for m in messages}
        }
        for topic, kind, log_ns, message in messages:
            writer.write(connections[topic], log_ns, TYPES.serialize_cdr(message, kind))
    return path


def messages_of(path: Path) -> list[tuple[str, str, int, Any]]:
    with Bag(path) as bag:
        return [(raw.topic, raw.msgtype, raw.log_ns, bag.decode(raw)) for raw in bag.messages()]


def driven(path: Path, config: Config, session_map: SessionMap, session: str | None = None) -> Any:
    with Bag(path) as bag:
        return drive(bag, config, make_encoder(config.encoder), session_map, session=session)


VALUES = {
    'encoder.name': 'ring_key',
    'encoder.ring_key.variance_scale': 2.1,
    'map.match_distance_m': 3.0,
    'query.top_k': 3,
    'query.delta': 0.5,
}
CONFIG = load_config(overrides=VALUES)


@dataclasses.dataclass
class SlowDrive:
    """The stages written a second time: interpolate, merge and search by loops over lists."""

    config: Config
    origin: GeoPoint | None = None
    places: list[dict[str, Any]] = dataclasses.field(default_factory=list)

    def drive(self, sequence: Any, geodetic: bool, mapped: bool) -> list[tuple[Any, ...]]:
        track: Trajectory = sequence.trajectory
        if geodetic and mapped:
            self.origin = self.origin or track.origin()
        frame = LocalFrame((self.origin if geodetic else None) or track.origin() or GeoPoint(0.0, 0.0))
        metres = frame.to_enu(track.positions)
        encoder = make_encoder(self.config.encoder)
        committed = [dict(place) for place in self.places]
        answers = []
        for index in range(len(sequence)):
            scan = encoder.encode(sequence.scan(index))
            searched = committed if self.config.query.exclude_current_session else self.places
            answers.append(self._query(scan, searched))
            if mapped:
                x, y = (float(np.interp(scan.stamp_ns, track.stamps_ns, metres[:, axis])) for axis in (0, 1))
                self._merge(scan, x, y)
        return answers

    def _merge(self, scan: Embedding, x: float, y: float) -> None:
        held = {'x': x, 'y': y, 'u': np.float32(scan.uncertainty), 'mean': scan.mean, 'stamp': scan.stamp_ns}
        reach = self.config.map.match_distance_m
        nearest = None
        for place in self.places:
            distance = math.hypot(place['anchor'][0] - x, place['anchor'][1] - y)
            if distance < reach:
                nearest, reach = place, distance
        if nearest is None:
            self.places.append({'id': len(self.places), 'anchor': (x, y), **held})
        elif held['u'] < nearest['u']:
            nearest.update(held)

    def _query(self, scan: Embedding, places: list[dict[str, Any]]) -> tuple[Any, ...]:
        ranked = sorted(
            (float(np.sqrt(np.sum((p['mean'].astype(float) - scan.mean.astype(float)) ** 2))), p['id']) for p in places
        )
        ids = tuple(place_id for _, place_id in ranked[: self.config.query.top_k])
        if not places:
            return scan.stamp_ns, 'map_empty', ids
        certain = scan.uncertainty <= 1.0 + self.config.query.delta
        return scan.stamp_ns, 'match' if certain else 'uncertain', ids


def brief(outcome: Outcome) -> tuple[Any, ...]:
    kind = 'match' if isinstance(outcome, Match) else outcome.reason.value
    return outcome.stamp_ns, kind, tuple(c.place_id for c in outcome.candidates)


@pytest.mark.parametrize(('source', 'exclude'), [('fix', True), ('odometry', True), ('fix', False)])
def test_drives_answer_and_map_as_slow_loops_do(
    street: Callable[..., Any], street_bag: Callable[..., Path], source: str, exclude: bool
) -> None:
    # The running session has a scan once its heading is known, unless none is asked for.
    heading = 'auto' if exclude else 'none'
    config = load_config(
        overrides=VALUES
        | {'position.source': source, 'position.heading': heading, 'query.exclude_current_session': exclude}
    )
    drives: list[tuple[dict[str, Any], bool]] = [
        ({'count': 12}, True),
        ({'count': 14, 'start_ns': 1_700_000_000 * SECOND, 'noise_seed': 1, 'degraded': (5,)}, True),
        ({'count': 12, 'start_ns': 1_800_000_000 * SECOND, 'noise_seed': 2, 'degraded': (2, 9)}, False),
    ]
    slow = SlowDrive(config)
    kinds: Counter[str] = Counter()
    with SessionMap(config.map) as session_map:
        for number, (options, mapped) in enumerate(drives):
            bag = street_bag(f'drive_{number}', **options)
            result = driven(bag, config, session_map, 'drive' if mapped else None)
            expected = slow.drive(street(**options), source == 'fix', mapped)
            assert [brief(outcome) for outcome in result.outcomes] == expected
            assert result.refused == Counter()
            kinds.update(kind for _, kind, _ in expected)
        table = session_map.places()
    assert kinds.keys() == {'map_empty', 'match', 'uncertain'}
    assert table.stamps_ns.tolist() == [place['stamp'] for place in slow.places]
    np.testing.assert_allclose(table.positions_m[:, :2], [(place['x'], place['y']) for place in slow.places], atol=1e-6)


def test_a_drive_that_is_not_mapped_changes_no_map(street_bag: Callable[..., Path]) -> None:
    with SessionMap(CONFIG.map) as session_map:
        driven(street_bag('first', count=6), CONFIG, session_map, 'one')
        before = session_map.places()
        path = street_bag('second', count=6, noise_seed=1)
        result = driven(path, CONFIG, session_map)
        after = session_map.places()
        # Positions are not even read.
        lost = driven(without_fix(path, lambda index: True), CONFIG, session_map)
    assert result.report is None
    assert result.refused == lost.refused == {}
    assert len(result.outcomes) == len(lost.outcomes) == 6
    assert before.stamps_ns.tolist() == after.stamps_ns.tolist()


def test_bad_images_are_refused_one_by_one(street: Callable[..., Any], street_bag: Callable[..., Path]) -> None:
    path = street_bag('sound', count=12)
    faults: dict[int, tuple[str, Callable[[Any], dict[str, Any]]]] = {
        1: ('wrong_encoding', lambda m: {'encoding': 'bgr8'}),
        3: ('short_step', lambda m: {'step': 100}),
        4: ('short_data', lambda m: {'data': m.data[:1000]}),
        6: ('empty_image', lambda m: {'height': 0, 'width': 0, 'step': 0, 'data': m.data[:0]}),
        7: ('no_signal', lambda m: {'data': np.zeros_like(m.data)}),
    }
    messages, index = [], -1
    for topic, kind, log_ns, message in messages_of(path):
        index += topic == SCANS
        fault = faults.get(index) if topic == SCANS else None
        changed = dataclasses.replace(message, **fault[1](message)) if fault else message
        messages.append((topic, kind, log_ns, changed))
    # Scans out of order: two again, one of them with another after it, and one that is late.
    stamps = street(count=12).stamps_ns
    late = [m for m in messages if m[0] == SCANS]
    messages += [
        (SCANS, IMAGE_TYPE, int(stamps[9]) + 1, late[9][3]),
        (SCANS, IMAGE_TYPE, int(stamps[10]) + 1, late[8][3]),
        (SCANS, IMAGE_TYPE, int(stamps[10]) + 2, dataclasses.replace(late[8][3], header=header(int(stamps[8]) + 1))),
    ]
    bad = write_messages(path.with_name('bad'), sorted(messages, key=lambda m: m[2]))
    with SessionMap(CONFIG.map) as session_map:
        result = driven(bad, CONFIG, session_map, 'one')
        table = session_map.places()
    # The late one is answered too, as invalid; those again were answered already.
    answered = [outcome.stamp_ns for outcome in result.outcomes]
    assert answered == [*stamps[:11].tolist(), int(stamps[8]) + 1, int(stamps[11])]
    invalid = [
        index
        for index, outcome in enumerate(result.outcomes)
        if isinstance(outcome, Rejection) and outcome.reason is Reason.INVALID_EMBEDDING
    ]
    assert invalid == [*sorted(faults), 11]
    expected = Counter(cause for cause, _ in faults.values())
    expected.update({'repeated_stamp': 2, 'stamp_backwards': 1, 'invalid_embedding': len(faults) + 1})
    assert result.refused == expected
    report = result.report
    assert report.inserted + report.replaced + report.kept == 12 - len(faults)
    assert dict(report.dropped) == {'invalid_embedding': len(faults) + 1}
    assert not set(table.stamps_ns.tolist()) & {int(stamps[index]) for index in faults}


def without_fix(path: Path, lost: Callable[[int], bool]) -> Path:
    """The bag with status -1 in the fixes whose number is `lost`, which then lie on the equator."""
    messages, index = [], -1
    for topic, kind, log_ns, message in messages_of(path):
        index += topic == FIX
        if topic == FIX and lost(index):
            status = dataclasses.replace(message.status, status=-1)
            message = dataclasses.replace(message, status=status, latitude=0.0, longitude=0.0)  # noqa: PLW2901
        messages.append((topic, kind, log_ns, message))
    return write_messages(path.with_name('lost'), messages)


def test_fixes_without_a_fix_are_refused(street_bag: Callable[..., Path]) -> None:
    path = street_bag('sound', count=10)
    with SessionMap(CONFIG.map) as session_map:
        driven(path, CONFIG, session_map, 'one')
        expected = session_map.places()
    lost = without_fix(path, lambda index: index % 3 == 1)
    with SessionMap(CONFIG.map) as session_map:
        result = driven(lost, CONFIG, session_map, 'one')
        found = session_map.places()
    fixes = sum(topic == FIX for topic, *_ in messages_of(path))
    assert result.refused == {'no_fix': len(range(1, fixes, 3))}
    assert found.stamps_ns.tolist() == expected.stamps_ns.tolist()
    # On a straight road at constant speed the fixes around a lost one say where it was.
    np.testing.assert_allclose(found.positions_m, expected.positions_m, atol=1e-4)


def test_without_any_fix_scans_are_answered_and_none_is_mapped(street_bag: Callable[..., Path]) -> None:
    lost = without_fix(street_bag('sound', count=5), lambda index: True)
    with SessionMap(CONFIG.map) as session_map:
        result = driven(lost, CONFIG, session_map, 'one')
        assert len(session_map) == 0
        assert session_map.origin is None
    assert [brief(outcome)[1] for outcome in result.outcomes] == ['map_empty'] * 5
    assert dict(result.report.dropped) == {'no_position': 5}
    assert result.refused['no_position'] == 5


def test_positions_are_those_of_the_configured_source(street_bag: Callable[..., Path]) -> None:
    lost = without_fix(street_bag('sound', count=5), lambda index: True)
    config = load_config(overrides=VALUES | {'position.source': 'odometry'})
    with SessionMap(config.map) as session_map:
        result = driven(lost, config, session_map, 'one')
        assert len(session_map) > 0
    assert result.refused == {}


def test_stamps_count_not_log_times(street_bag: Callable[..., Path]) -> None:
    path = street_bag('sound', count=8)
    delays_ns = {SCANS: 240_000_000, FIX: 90_000_000}
    late = [(topic, kind, log_ns + delays_ns.get(topic, 0), m) for topic, kind, log_ns, m in messages_of(path)]
    late_path = write_messages(path.with_name('late'), sorted(late, key=lambda m: m[2]))
    tables, outcomes = [], []
    for each in (path, late_path):
        with SessionMap(CONFIG.map) as session_map:
            outcomes.append([brief(outcome) for outcome in driven(each, CONFIG, session_map, 'one').outcomes])
            tables.append(session_map.places())
    assert outcomes[0] == outcomes[1]
    assert tables[0].stamps_ns.tolist() == tables[1].stamps_ns.tolist()
    np.testing.assert_array_equal(tables[0].positions_m, tables[1].positions_m)


def test_a_bag_without_positions_of_the_configured_source_maps_nothing(street_bag: Callable[..., Path]) -> None:
    path = street_bag('sound', count=4)
    scans = [m for m in messages_of(path) if m[0] == SCANS]
    with SessionMap(CONFIG.map) as session_map:
        result = driven(write_messages(path.with_name('bare'), scans), CONFIG, session_map, 'one')
    assert result.refused == {'no_position': 4}
    assert len(result.outcomes) == 4


def test_a_recording_played_twice_is_answered_twice_and_maps_the_same_places(
    street_bag: Callable[..., Path],
) -> None:
    """As `replay_node --loop 2` does with the nodes' stages."""
    path = street_bag('drive', count=10)
    encoder = make_encoder(CONFIG.encoder)
    embeddings: list[Embedding] = []
    updates: list[MapUpdate] = []
    restarts: list[int] = []
    with SessionMap(CONFIG.map) as session_map, Bag(path) as bag:
        session_map.adopt_model(encoder.info)
        session_map.start_session('twice', 0)
        encode, mapping = EncodeStage(encoder, 1.0, signature=True), MapStage(CONFIG, session_map)
        for _ in range(2):
            for raw in in_lockstep_order(bag, SCANS, [FIX], 1.5):
                message = bag.decode(raw)
                stamp = stamp_ns(message.header.stamp)
                if raw.topic == FIX:
                    updates += mapping.add_point(stamp, point_from_fix(message))
                    continue
                encoded = encode.encode(stamp, functools.partial(scan_from_image, message, RadarConfig()))
                assert encoded.problem is None
                assert encoded.embedding is not None
                if encoded.restarted:
                    restarts.append(len(embeddings))
                embeddings.append(encoded.embedding)
                updates += mapping.add_embedding(encoded.embedding)
        once = len(session_map)
        last, report = mapping.end_session()
    assert restarts == [10]
    assert [e.mean.tobytes() for e in embeddings[:10]] == [e.mean.tobytes() for e in embeddings[10:]]
    assert [u.stamp_ns for u in [*updates, *last]] == [e.stamp_ns for e in embeddings]
    assert not any(update.problem for update in updates)
    assert report.inserted + report.replaced + report.kept == 20
    assert report.inserted == once
    assert not report.dropped


def test_scans_of_which_no_signature_can_be_made_are_mapped_and_told_of(
    street_bag: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> NoReturn:
        raise ValueError('too strange')

    path = street_bag('drive', count=4)
    maps, warnings = [], []
    for breaks in (False, True):
        with SessionMap(CONFIG.map) as session_map, monkeypatch.context() as patch:
            if breaks:
                patch.setattr(SignatureMaker, '__call__', fail)
            result = driven(path, CONFIG, session_map, 'one')
            warnings.append(result.warnings)
            scans = [ScanKey(1, stamp) for stamp in session_map.places().stamps_ns.tolist()]
            maps.append((session_map.places().means.tobytes(), len(session_map.signatures.read(scans)) / len(scans)))
    assert warnings == [(), ('no signature could be made of 4 scans: ValueError: too strange',)]
    assert maps == [(maps[0][0], 1.0), (maps[0][0], 0.0)]


def test_a_table_of_places_answers_as_its_map(street_bag: Callable[..., Path]) -> None:
    encoder = make_encoder(CONFIG.encoder)
    with SessionMap(CONFIG.map) as session_map:
        driven(street_bag('first', count=6), CONFIG, session_map, 'one')
        with Bag(street_bag('second', count=6, noise_seed=1)) as bag:
            by_map = drive(bag, CONFIG, encoder, session_map)
            by_table = drive(bag, CONFIG, encoder, session_map.committed(), signatures=session_map.signatures)
    assert any(outcome.candidates[0].alignment for outcome in by_map.outcomes)
    assert [key(outcome) for outcome in by_table.outcomes] == [key(outcome) for outcome in by_map.outcomes]
    assert by_table.report is None


def test_progress_counts_to_the_number_of_scans(street_bag: Callable[..., Path]) -> None:
    seen: list[tuple[int, int]] = []
    with SessionMap(CONFIG.map) as session_map, Bag(street_bag('drive', count=4)) as bag:
        encoder = make_encoder(CONFIG.encoder)
        drive(bag, CONFIG, encoder, session_map, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
