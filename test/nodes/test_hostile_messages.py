"""No message ends a node or spoils what it does later: sound scans are mapped and answered, also after a restart."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from hostile_messages import Hostile, hostile_messages, inputs
from live_nodes import Observer, StartNode, wait_until
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, NavSatFix
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.store import MapStore
from offradar_ros.messages import stamp_ns
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.ros import qos
from offradar_ros.types import Outcome, PlaceTable

SECOND = 10**9
START_NS = 1000 * SECOND
SEED = 7
ROUNDS = 100
"""Hostile messages on each topic."""
MODEL = make_encoder(EncoderConfig(name='ring_key')).info
DEEP = {
    f'qos_overrides./{topic}.subscription.depth': 1000
    for topic in (
        'radar_data/b_scan_image',
        'embedding',
        'embedding/model',
        'map/descriptors',
        'map/updates',
        'map/signatures',
        'map/signatures_wanted',
    )
}
"""Every message is handled, however late the nodes are."""
FIRST = range(100, 180, 20)
"""Scans of the first drive, by their numbers: 14 m and 5 s apart."""
MEMORY_BYTES = 300 * 2**20
"""What a node may need more after all of them: a few of the largest messages."""


class Vehicle:
    """Publishes all inputs of the nodes, and receives their answers."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._publish: dict[str, Callable[[Any], None]] = {}
        self._make = {one.topic: one.make for one in inputs(MODEL, START_NS)}
        self._outcomes: list[Outcome] = observer.collect_outcomes()
        self._handled: list[Header] = observer.collect(Header, 'map_server/handled', qos.UPDATES)
        self._diagnostics: list[DiagnosticArray] = observer.collect(DiagnosticArray, '/diagnostics')

    def wait_until_connected(self) -> None:
        self._observer.wait_until_connected(**{'map_server/handled': 1})

    def send(self, topic: str, kind: type, profile: QoSProfile, message: Any) -> None:
        if topic not in self._publish:
            deep = QoSProfile(depth=1000, reliability=profile.reliability, durability=profile.durability)
            self._publish[topic] = self._observer.publisher(kind, topic, deep)
        self._publish[topic](message)

    def send_hostile(self, one: Hostile) -> None:
        self.send(one.topic, one.kind, one.profile, one.message)

    def call(self, name: str) -> str:
        answer = self._observer.call(Trigger, f'map_server/{name}', Trigger.Request())
        assert answer.success, answer.message
        return str(answer.message)

    def drive(self, numbers: range) -> str:
        """A session of four scans, 14 m apart; returns its report."""
        self.call('start_session')
        for number in range(numbers.start - 4, numbers.stop):
            self.send('gps/fix', NavSatFix, qos.POSITIONS, self._make['gps/fix'](number))
        for number in numbers:
            self.ask(number)
        return self.call('end_session')

    def ask(self, number: int, shown: int | None = None) -> Outcome:
        """The answer to a scan, when the map server has handled it too; it looks like scan number `shown`."""
        image = self._make['radar_data/b_scan_image'](number)
        image.data = self._make['radar_data/b_scan_image'](number if shown is None else shown).data
        scan_ns = stamp_ns(image.header.stamp)
        self.send('radar_data/b_scan_image', Image, qos.SCANS, image)
        wait_until(lambda: [h for h in self._handled if h.stamp == image.header.stamp])
        answers: list[Outcome] = wait_until(lambda: [o for o in self._outcomes if o.stamp_ns == scan_ns])
        assert len(answers) == 1
        return answers[0]

    def counts(self) -> dict[str, Counter[str]]:
        """What each node has handled, and dropped by cause, by diagnostics that come from now on."""
        del self._diagnostics[:]
        found: dict[str, Counter[str]] = {}

        def is_complete() -> bool:
            for status in (status for message in list(self._diagnostics) for status in message.status):
                values = {item.key: item.value for item in status.values}
                known = {key: int(values[key]) for key in values if key == 'handled' or key.startswith('dropped.')}
                found[status.name.partition(':')[0]] = Counter(known)
            return len(found) == 3

        wait_until(is_complete)
        return found

    def settle(self) -> dict[str, Counter[str]]:
        """The counts, when they do not change any more: every message has been handled."""
        last = [self.counts()]
        while len(last) < 4 or any(counts != last[-1] for counts in last[-4:]):
            last.append(self.counts())
        return last[-1]


def dropped(counts: Counter[str]) -> int:
    return counts.total() - counts['handled']


def assert_healthy(nodes: Stack) -> None:
    for node in nodes.nodes.values():
        log = node.log.read_text(errors='replace')
        assert node.process.poll() is None, f'{node.name} ended with {node.process.returncode}: {log[-2000:]}'
        assert 'Traceback' not in log, f'{node.name}: {log[log.index("Traceback") :][:3000]}'


def same(one: PlaceTable, other: PlaceTable) -> bool:
    return np.array_equal(one.place_ids, other.place_ids) and np.array_equal(one.means, other.means)


def test_a_hundred_hostile_messages_of_each_kind_change_nothing_for_sound_ones(
    observer: Observer, stack: Callable[..., Stack], tmp_path: Path
) -> None:
    path, vehicle = tmp_path / 'town.db', Vehicle(observer)
    parameters = {
        'map.path': str(path),
        'map.autosave_s': 0.0,
        'map.allow_destructive': True,
        'encoder.backlog': 1000,
    } | DEEP
    own = {'map_server_node': {'position.source': 'fix'}}
    with stack(parameters, own_parameters=own) as nodes:
        nodes.wait_until_ready()
        vehicle.wait_until_connected()
        assert '4 inserted' in vehicle.drive(FIRST), vehicle.counts()
        before = MapStore.open_read_only(path).places
        memory = {name: usage.resident_bytes for name, usage in nodes.usage().items()}

        vehicle.call('start_session')
        sent = 0
        for one in itertools.islice(hostile_messages(SEED, MODEL, START_NS), ROUNDS * len(inputs(MODEL, START_NS))):
            if one.topic != 'ground_truth/odometry':
                vehicle.send_hostile(one)
                sent += 1
        assert sent == 9 * ROUNDS
        wait_until(lambda: all(dropped(counts) > ROUNDS / 4 for counts in vehicle.counts().values()))
        counts = vehicle.settle()
        assert_healthy(nodes)
        assert not any('dropped.internal_error' in causes for causes in counts.values()), counts
        grown = {name: usage.resident_bytes - memory[name] for name, usage in nodes.usage().items()}
        assert max(grown.values()) < MEMORY_BYTES, grown

        vehicle.call('undo_session')
        assert '4 inserted' in vehicle.drive(range(20_000, 20_080, 20)), vehicle.counts()
        answer = vehicle.ask(30_000, shown=120)
        assert answer.candidates[0].place_id == before.place_ids[1]
        assert_healthy(nodes)
    stored = MapStore.open_read_only(path)
    assert same(before, PlaceTable(*(getattr(stored.places, name)[:4] for name in PlaceTable.__slots__)))
    assert (len(stored.places), stored.model) == (8, MODEL)

    # What is latched, the hostile messages among it, reaches the nodes again when they start.
    with stack(parameters, own_parameters=own) as nodes:
        nodes.wait_until_ready()
        vehicle.wait_until_connected()
        wait_until(lambda: all(dropped(vehicle.counts()[name]) > ROUNDS / 4 for name in ('map_server', 'query')))
        vehicle.settle()
        assert '4 inserted' in vehicle.drive(range(40_000, 40_080, 20)), vehicle.counts()
        assert vehicle.ask(50_000, shown=120).candidates[0].place_id == before.place_ids[1]
        assert_healthy(nodes)


def test_hostile_odometry_does_not_spoil_the_positions_of_later_scans(
    observer: Observer, start_node: StartNode
) -> None:
    node = start_node(MapServerNode, {'position.source': 'odometry'})
    topic = 'ground_truth/odometry'
    known = {one.topic: one for one in inputs(MODEL, START_NS)}

    def publisher(name: str) -> Callable[[Any], None]:
        return observer.publisher(known[name].kind, name, known[name].profile)

    send, embed, tell_model = publisher(topic), publisher('embedding'), publisher('embedding/model')
    tell_model(known['embedding/model'].make(0))
    wait_until(lambda: node.stage.map.model == MODEL)
    for one in itertools.islice((m for m in hostile_messages(SEED, MODEL, START_NS) if m.topic == topic), ROUNDS):
        send(one.message)
    numbers = itertools.count(1000)

    def is_mapped_again() -> bool:
        # The drive goes on: a scan that overtakes the positions before it finds none.
        number = next(numbers)
        send(known[topic].make(number))
        embed(known['embedding'].make(number - 2))
        return len(node.stage.map) > 2

    wait_until(is_mapped_again)
    places = node.stage.map.places()
    assert places.positions_m[:, 0].tolist() == ((places.stamps_ns - START_NS) / (0.25 * SECOND)).tolist()
    drops = node.status.drops
    assert drops['invalid_position'] and drops['invalid_stamp'] and not drops['internal_error'], drops
