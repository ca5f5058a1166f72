"""One input of a node: its subscription, whether messages come, and if not, why."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from offradar_ros.ros.diagnostics import Trouble
from offradar_ros.ros.input_watch import InputWatch
from offradar_ros.ros.topic_hints import LISTED, NOBODY, full_name, why_silent


class Input:
    """A subscription that follows its publishers, and says why it is silent.

    A reliable one hears nobody who publishes best effort, as many receivers of positions do. It becomes best effort
    while all publishers are, unless a `qos_overrides` parameter sets its reliability. It is not best effort from the
    start, because a replay in lockstep sends more at once than that can take.

    Args:
        node: the node that subscribes.
        message_type: class of the messages.
        topic: as the node names it, before remapping.
        profile: quality of service, where parameters do not override it.
        receive: called with each message.
        source: who publishes there, as text for a hint; empty if the node does its work without this input.
        instead: other types with the same content, and what to do where somebody publishes one.
        is_needed: whether the node needs messages now.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        profile: QoSProfile,
        receive: Callable[[Any], None],
        *,
        source: str = '',
        instead: Mapping[str, str] | None = None,
        is_needed: Callable[[], bool] = lambda: True,
    ) -> None:
        self.topic = topic
        self.watch = InputWatch()
        self.last_why = ''
        """Why it was silent when messages were missed, and what to do as far as was ever known; empty if none were."""
        self._node, self._message_type, self._receive = node, message_type, receive
        self._source, self._instead, self._is_needed = source, instead, is_needed
        # rclpy writes overrides into the profile that it is given, which other subscriptions share.
        self._subscription: Subscription = node.create_subscription(
            message_type,
            topic,
            receive,
            copy.copy(profile),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._profile: QoSProfile = copy.copy(self._subscription.qos_profile)

    @property
    def subscription(self) -> Subscription:
        """The present subscription."""
        return self._subscription

    @property
    def type_name(self) -> str:
        """Such as ``sensor_msgs/msg/Image``."""
        return f'{self._message_type.__module__.partition(".")[0]}/msg/{self._message_type.__name__}'

    def follow_publishers(self, overridden: bool) -> str:
        """Take over the reliability of the publishers; one line if that changed it, else empty."""
        if (
            overridden
            or self._profile.reliability != ReliabilityPolicy.RELIABLE
            or self._profile.durability != DurabilityPolicy.VOLATILE
        ):
            return ''
        name = self._subscription.topic_name
        publishers = [
            each for each in self._node.get_publishers_info_by_topic(name) if each.topic_type == self.type_name
        ]
        unreliable = [each for each in publishers if each.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT]
        wanted = ReliabilityPolicy.BEST_EFFORT if len(unreliable) == len(publishers) else ReliabilityPolicy.RELIABLE
        if not publishers or wanted == self._subscription.qos_profile.reliability:
            return ''
        self._node.destroy_subscription(self._subscription)
        profile = copy.copy(self._profile)
        profile.reliability = wanted
        self._subscription = self._node.create_subscription(self._message_type, name, self._receive, profile)
        if wanted == ReliabilityPolicy.RELIABLE:
            return f'{name}: listens reliably again'
        return f'{name}: {full_name(unreliable[0])} publishes best effort: listens best effort, and may miss messages'

    def count_audible(self) -> int:
        """How many publishers can be heard: those of this type and of a quality of service that fits."""
        wanted = self._subscription.qos_profile
        return sum(
            each.topic_type == self.type_name
            and qos_check_compatible(each.qos_profile, wanted)[0] != QoSCompatibility.ERROR
            for each in self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        )

    def rival_sources(self) -> Trouble | None:
        """That more than one publisher sends what one vehicle has one of; None if not."""
        if not self._source or self._profile.durability != DurabilityPolicy.VOLATILE:
            return None
        name = self._subscription.topic_name
        offers = self._node.get_publishers_info_by_topic(name)
        found = sorted(full_name(each) for each in offers if each.topic_type == self.type_name)
        if len(found) < 2:
            return None
        text = f'{name} is published by {" and ".join(found)}, and mixed: stop one, or remap it ({LISTED})'
        return Trouble(f'several_sources.{self.topic}', text)

    def trouble(self) -> Trouble | None:
        """Why nothing comes, once that is longer than usual; None while messages come or are not needed."""
        if not self._source or not self.watch.is_silent or not self._is_needed():
            return None
        why = self.why_silent()
        # Whoever publishes elsewhere may end before the session does.
        if not (self.last_why and why.startswith(NOBODY)):
            self.last_why = why
        return Trouble(f'silent.{self.topic}', f'{self.silence()}: {why}', is_error=self.watch.is_dead)

    def silence(self) -> str:
        """How long nothing came, as text."""
        name = self._subscription.topic_name
        if self.watch.ever:
            return f'nothing on {name} for {self.watch.silent_s:.0f} s'
        return f'nothing ever came on {name} in {self.watch.silent_s:.0f} s'

    def why_silent(self) -> str:
        """As the graph of nodes shows it, with what to do."""
        profile = self._subscription.qos_profile
        return why_silent(self._node, self.topic, self.type_name, profile, self._source, self._instead)
