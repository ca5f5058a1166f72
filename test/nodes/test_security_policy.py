"""The shipped SROS2 policy: its form, what it grants against what the nodes use, and nodes that never start open."""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from live_nodes import Observer, StartNode, wait_until
from rclpy.node import NodeNameNonExistentError
from recorded_topics import compressed_scans, fixes, record, scans
from street_sequence import StreetSequence

from offradar_ros.cli.session import SERVICES, Action
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.nodes.map_server_node import DESTRUCTIVE, MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros import navtech
from offradar_ros.ros.connections import SUBSCRIBERS
from offradar_ros.ros.stage_node import StageNode

POLICY = Path(__file__).resolve().parents[2] / 'params' / 'sros2' / 'policy.xml'
RULES = ('publish', 'subscribe', 'reply', 'request')
GRAPH = {'publish': 'publisher', 'subscribe': 'subscriber', 'reply': 'service', 'request': 'client'}
NODES: dict[str, Callable[..., StageNode]] = {'encoder': EncoderNode, 'map_server': MapServerNode, 'query': QueryNode}
NAVTECH = {'/radar_data/b_scan_msg', '/radar_data/configuration_data'}
"""Subscribed to only where `navtech_msgs` is installed."""
TRANSPORTS = {'raw': '/radar_data/b_scan_image', 'compressed': '/radar_data/b_scan_image/compressed'}
"""Only one of them is used, as `radar.transport` says."""
IN_A_BAG = {'/gps/fix', '/ground_truth/odometry', '/odometry'}
"""A replay publishes those of them that are in its bag."""

WAIT_S = 20.0

Grants = dict[str, set[str]]


def grants(enclave: str, node: str, namespace: str = '') -> Grants:
    """The full names that a node of an enclave in a namespace may publish, subscribe to, reply to and request."""
    found: Grants = {rule: set() for rule in RULES}
    tree = ElementTree.parse(POLICY).getroot()
    (profile,) = tree.findall(f'enclaves/enclave[@path="/offradar/{enclave}"]/profiles/profile[@node="{node}"]')
    for expressions in profile:
        (rule,) = expressions.keys()
        for name in expressions:
            text = name.text or ''
            absolute = text if text.startswith('/') else f'{namespace}/{text.replace("~", node, 1)}'
            found[rule].add(absolute)
    return found


def used(observer: Observer, node: str, namespace: str = '') -> Grants:
    """The same, as the graph shows that a running node uses it; nothing while it has not been discovered."""

    def names(kind: str) -> set[str]:
        try:
            return {
                name
                for name, _ in getattr(observer.node, f'get_{kind}_names_and_types_by_node')(node, namespace or '/')
            }
        except NodeNameNonExistentError:
            return set()

    return {rule: names(kind) for rule, kind in GRAPH.items()}


def differences(
    observer: Observer, node: str, expected: Grants, namespace: str = ''
) -> dict[str, tuple[set[str], set[str]]]:
    """By rule, what the node uses without a grant, and what it is granted and does not use; empty if there is none."""
    deadline_s = time.monotonic() + WAIT_S
    while True:
        found = used(observer, node, namespace)
        wrong = {rule: (found[rule] - expected[rule], expected[rule] - found[rule]) for rule in RULES}
        wrong = {rule: sets for rule, sets in wrong.items() if any(sets)}
        # It takes a while until all is discovered.
        if not wrong or time.monotonic() > deadline_s:
            return wrong
        time.sleep(0.02)


def test_the_policy_has_the_form_of_sros2() -> None:
    """That of sros2/policy/schemas/policy.xsd, version 0.2.0."""
    policy = ElementTree.parse(POLICY).getroot()
    assert (policy.tag, policy.attrib) == ('policy', {'version': '0.2.0'})
    (enclaves,) = policy
    assert enclaves.tag == 'enclaves'
    paths = [enclave.get('path') for enclave in enclaves]
    assert len(set(paths)) == len(paths)
    for enclave in enclaves:
        assert (enclave.tag, set(enclave.attrib)) == ('enclave', {'path'})
        assert [child.tag for child in enclave] == ['profiles']
        for profile in enclave[0]:
            assert (profile.tag, set(profile.attrib)) == ('profile', {'ns', 'node'})
            for expressions in profile:
                assert expressions.tag in ('topics', 'services')
                allowed = ('publish', 'subscribe') if expressions.tag == 'topics' else ('reply', 'request')
                ((rule, qualifier),) = expressions.items()
                assert rule in allowed
                assert qualifier == 'ALLOW'
                texts = [name.text or '' for name in expressions]
                assert {name.tag for name in expressions} == {expressions.tag[:-1]}
                assert len(set(texts)) == len(texts)
                # An expression with a wildcard would grant names that nobody has looked at.
                assert all(text.replace('/', '').replace('~', '').replace('_', '').isalnum() for text in texts)


@pytest.mark.parametrize(('source', 'transport'), [('fix', 'raw'), ('odometry', 'compressed')])
def test_each_node_uses_what_it_is_granted_and_nothing_else(
    observer: Observer, start_node: StartNode, source: str, transport: str
) -> None:
    # Of its own: another program on this machine may have nodes of these names.
    namespace = f'/policy_{os.getpid()}'
    positions = {'fix': f'{namespace}/gps/fix', 'odometry': f'{namespace}/ground_truth/odometry'}
    for name, kind in NODES.items():
        parameters: dict[str, Any] = {'use_sim_time': True}
        if kind is MapServerNode:
            parameters['position.source'] = source
        if kind is EncoderNode:
            parameters['radar.transport'] = transport
        if kind is QueryNode:
            parameters['query.initial_pose'] = source == 'fix'
        start_node(functools.partial(kind, namespace=namespace), parameters)
        expected = grants(name, name, namespace)
        expected['subscribe'] -= {topic for key, topic in positions.items() if key != source}
        expected['subscribe'] -= {namespace + topic for key, topic in TRANSPORTS.items() if key != transport}
        if source != 'fix':
            expected['publish'] -= {f'{namespace}/initialpose'}
        if navtech.message_types() is None:
            expected['subscribe'] -= {namespace + topic for topic in NAVTECH}
        assert differences(observer, name, expected, namespace) == {}


@pytest.mark.parametrize('transport', ['raw', 'compressed'])
def test_a_replay_uses_what_it_is_granted(
    observer: Observer,
    stack: Callable[..., Stack],
    street: Callable[..., StreetSequence],
    tmp_path: Path,
    transport: str,
) -> None:
    drive = street(count=4)
    bag = record(tmp_path / 'bag', (scans if transport == 'raw' else compressed_scans)(drive), fixes(drive))
    with stack({'radar.transport': transport}) as nodes:
        nodes.wait_until_ready()
        process = nodes.start('replay_node', [str(bag), '--session', '--loop', '0'], 'replay_forever')
        granted = grants('replay', 'replay')
        try:
            # The clients of the session last for one call.
            lasting = granted['request'] - {'/map_server/start_session', '/map_server/end_session'}
            wait_until(lambda: used(observer, 'replay')['publish'])
            wrong = differences(observer, 'replay', granted | {'request': lasting})
            assert {rule for rule, (strange, _) in wrong.items() if strange} == set()
            unused = set().union(*(unused for _, unused in wrong.values()))
            assert unused <= IN_A_BAG | set(TRANSPORTS.values()) - {TRANSPORTS[transport]}
        finally:
            process.stop()


def test_who_may_take_drives_away() -> None:
    services = {f'/map_server/{SERVICES[action]}' for action in Action}
    destructive = {f'/map_server/{name}' for name in DESTRUCTIVE}
    services.add(f'/map_server/{SUBSCRIBERS}')
    assert grants('session', 'offradar_session')['request'] == services - destructive
    assert services <= grants('operator', 'offradar_session')['request']
    for enclave, node in (*((name, name) for name in NODES), ('replay', 'replay'), ('replay', 'replay_end')):
        assert not grants(enclave, node)['request'] & destructive


def test_each_output_has_one_enclave_that_may_publish_it() -> None:
    shared = {'/diagnostics', '/parameter_events', '/rosout', '/clock'}
    written: dict[str, str] = {}
    for enclave, node in (*((name, name) for name in NODES), ('replay', 'replay'), ('session', 'offradar_session')):
        for topic in grants(enclave, node)['publish'] - shared:
            assert topic not in written, f'{topic}: {written[topic]} and {enclave}'
            written[topic] = enclave
    assert written['/embedding'] == written['/embedding/model'] == 'encoder'
    assert written['/map/descriptors'] == written['/map/updates'] == written['/map/signatures'] == 'map_server'
    assert written['/map/signatures_wanted'] == 'query'


@pytest.mark.parametrize('name', ['encoder_node', 'map_server_node', 'query_node'])
def test_a_node_never_starts_open_where_security_is_enforced(
    stack: Callable[..., Stack], tmp_path: Path, name: str
) -> None:
    """Neither without security in the middleware, as in the wheels, nor with a keystore that is none."""
    enclave = tmp_path / 'keystore' / 'enclaves' / 'offradar' / name.removesuffix('_node')
    enclave.mkdir(parents=True)
    for file in ('identity_ca.cert.pem', 'cert.pem', 'key.pem', 'permissions_ca.cert.pem'):
        (enclave / file).write_text('not a key')
    security = {
        'ROS_SECURITY_ENABLE': 'true',
        'ROS_SECURITY_STRATEGY': 'Enforce',
        'ROS_SECURITY_KEYSTORE': str(tmp_path / 'keystore'),
        'ROS_SECURITY_ENCLAVE_OVERRIDE': f'/offradar/{enclave.name}',
    }
    with stack(names=(name,), environment=security) as nodes:
        node = nodes.nodes[name]
        assert node.wait(60.0) != 0
        assert 'active: ' not in node.log.read_text()
