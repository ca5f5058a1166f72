"""Why nothing comes on a topic, and who else speaks on it, as the graph of nodes shows it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from offradar_ros.ros.connections import UNKNOWN

LISTED = 'one that died is listed for 20 s'
"""What to think of a node that is named and does not run any more."""
NOBODY = 'nobody publishes there:'
"""How a hint begins that names nobody."""
MAX_NAMED = 5
"""Most topics or nodes that a hint names."""
_SHARED_TYPES = ('sensor_msgs/msg/PointCloud2', 'diagnostic_msgs/msg/DiagnosticStatus')
"""Types of many different contents: a topic of them is only suggested if its name ends as the one that is missing."""


def why_silent(
    node: Node, topic: str, type_name: str, profile: QoSProfile, source: str, instead: Mapping[str, str] | None = None
) -> str:
    """Why a subscription receives nothing, and what to do.

    Args:
        node: the node that subscribes.
        topic: the topic as the node names it, before remapping.
        type_name: as ``sensor_msgs/msg/Image``.
        profile: quality of service of the subscription.
        source: who should publish there, such as `the radar's driver`.
        instead: other types with the same content, and what to do where somebody publishes one.
    """
    name = node.resolve_topic_name(topic)
    offers = node.get_publishers_info_by_topic(name)
    ours = [each for each in offers if each.topic_type == type_name]
    mismatched = [(each, why) for each in ours if (why := _mismatch(each.qos_profile, profile))]
    if ours and len(mismatched) < len(ours):
        return f'{_names(ours)} publishes there, and sends nothing: see its log'
    if mismatched:
        endpoint, why = mismatched[0]
        return f'{full_name(endpoint)} publishes there with another quality of service: {why.format(name)}'
    if offers:
        return f'{_names(offers)} publishes {offers[0].topic_type} there, not {type_name}: remap one of the two'
    others = _published(node, type_name, name, topic)
    if others:
        return f'nobody publishes there, but {type_name} is published on {others}: remap it (-r {topic}:=TOPIC)'
    for kind, remedy in (instead or {}).items():
        if found := _published(node, kind, name, topic):
            return f'nobody publishes there, but {kind} is published on {found}: {remedy}'
    return f'{NOBODY} is {source} running, in this domain and namespace?'


def rivals(node: Node, topics: Iterable[str]) -> dict[str, str]:
    """Who also publishes what `node` publishes, as text, with these topics; `topics` has a name for each publisher.

    A second node of the same name shows itself by one more publisher than this node has.
    """
    own, found = full_name(node), dict[str, list[str]]()
    for name, count in Counter(topics).items():
        publishers = [each for each in node.get_publishers_info_by_topic(name) if each.node_name != UNKNOWN]
        others = {full_name(each) for each in publishers if full_name(each) != own}
        if sum(full_name(each) == own for each in publishers) > count:
            others.add(f'another {own}')
        for other in others:
            found.setdefault(other, []).append(name)
    return {other: _listed(names) for other, names in found.items()}


def publishers(node: Node, topic: str) -> str:
    """Names of the nodes that publish a topic, each as often as it does so."""
    name = node.resolve_topic_name(topic)
    return ', '.join(sorted(full_name(each) for each in node.get_publishers_info_by_topic(name)))


def foreign_types(node: Node, topics: Mapping[str, str]) -> dict[str, str]:
    """Topics, given with the types that `node` publishes on them, that also carry another type, and which."""
    known = dict(node.get_topic_names_and_types())
    return {name: _listed(others) for name, kind in topics.items() if (others := {*known.get(name, ())} - {kind})}


def full_name(endpoint: TopicEndpointInfo | Node) -> str:
    """Name of a node with its namespace."""
    if isinstance(endpoint, Node):
        return str(endpoint.get_fully_qualified_name())
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _mismatch(offered: QoSProfile, requested: QoSProfile) -> str:
    """What to do about qualities of service with which nothing is sent; empty if something is. {} is the topic."""
    compatibility, reason = qos_check_compatible(offered, requested)
    if compatibility != QoSCompatibility.ERROR:
        return ''
    if offered.reliability == ReliabilityPolicy.BEST_EFFORT and requested.reliability == ReliabilityPolicy.RELIABLE:
        return 'best effort: set the parameter qos_overrides.{}.subscription.reliability to best_effort'
    return f'{str(reason).strip().rstrip(";").replace("{", "").replace("}", "")}: make it publish reliable, and latched'


def _published(node: Node, type_name: str, own_name: str, topic: str) -> str:
    """Other topics of a type that somebody publishes, as text."""
    ending = topic.rpartition('/')[2]
    found = [
        name
        for name, types in node.get_topic_names_and_types()
        if type_name in types
        and name != own_name
        and (type_name not in _SHARED_TYPES or name.rpartition('/')[2] == ending)
        and node.count_publishers(name)
    ]
    return _listed(found)


def _names(offers: Iterable[TopicEndpointInfo]) -> str:
    return _listed({full_name(each) for each in offers})


def _listed(names: Iterable[str]) -> str:
    shown = sorted(names)
    return ', '.join(shown[:MAX_NAMED]) + (f' and {len(shown) - MAX_NAMED} more' if len(shown) > MAX_NAMED else '')
