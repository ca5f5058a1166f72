"""What the three nodes share: lifecycle with autostart, parameters, diagnostics, and a guard against bad messages."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, TypeVar, cast

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.task import Future

from offradar_ros.config import Config
from offradar_ros.entry_point import explain
from offradar_ros.errors import OffradarError, RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.ros import parameters, qos
from offradar_ros.ros.connections import serve_subscribers
from offradar_ros.ros.diagnostics import NodeStatus, Trouble
from offradar_ros.ros.input import Input
from offradar_ros.ros.ledger import Ledger
from offradar_ros.ros.lifecycle import SteadyLifecycleNode
from offradar_ros.ros.lost_messages import LostMessages
from offradar_ros.ros.topic_hints import LISTED, foreign_types, full_name, rivals

MessageT = TypeVar('MessageT')


def _stamp_of(message: Any) -> int | None:
    """Stamp of a message's header; None without one, and for one that is none: whoever handles it refuses it."""
    header = getattr(message, 'header', None)
    try:
        return None if header is None else stamp_ns(header.stamp)
    except RefusedInput:
        return None


LOG_PERIOD_S = 5.0
TROUBLE_PERIOD_S = 30.0
"""A trouble that comes and goes is logged once in this time; the diagnostics have it every second."""


@dataclasses.dataclass(frozen=True)
class _Latched:
    """Messages of a latched topic, to be handled when the node becomes active.

    Attributes:
        handled: handles again the last one that was handled.
        later: handles one that came after it and was refused; its time may come, as for a full disk.
    """

    handled: Callable[[], None] | None = None
    later: Callable[[], None] | None = None


class StageNode(SteadyLifecycleNode):
    """A lifecycle node around one stage of the core.

    Subclasses build their core objects in `configure`, which may raise OffradarError. Inputs are ignored unless the
    node is active. A transition that fails leaves the node as it was.
    """

    parameter_groups: tuple[str, ...] = ()
    """The parts of the configuration whose parameters the node declares, such as ``query``."""
    timed_topic = ''
    """The input whose rate and latency the diagnostics report."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        overrides = options.get('parameter_overrides') or ()
        self.config = parameters.declare(self, Config(), self.parameter_groups, overrides)
        self._overridden = parameters.names_given(self, overrides)
        self._autostart = self.declare_parameter(
            'autostart', True, ParameterDescriptor(description='configure and activate at start', read_only=True)
        ).value
        self.add_on_set_parameters_callback(self._validate_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self.status = NodeStatus(f'{self.get_fully_qualified_name().lstrip("/")}: offradar_ros')
        self.active = False
        self._outputs: list[Publisher] = []
        self._shared: set[str] = set()
        self._output_types: dict[str, str] = {}
        self._inputs: list[Input] = []
        self._latched: dict[str, _Latched] = {}
        self.ledgers: list[Ledger] = []
        """What became of the messages of the inputs that are answered."""
        self._starting = False
        self._failure: Exception | None = None
        self._last_logged_s: dict[str, float] = {}
        for line in parameters.not_ours(self._overridden):
            self.get_logger().warning(line)
        serve_subscribers(self, self._outputs)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', qos.RESULTS)
        # Diagnostics must go on while a paused replay holds the ROS clock.
        self._report_timer = self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Configure and activate, unless `autostart` is false; raises the error that prevented it."""
        if not self._autostart:
            return
        self._starting = True
        try:
            for transition in (self.trigger_configure, self.trigger_activate):
                if transition() != TransitionCallbackReturn.SUCCESS:
                    raise self._failure or OffradarError(f'{self.get_name()}: could not be activated')
        finally:
            self._starting = False

    def configure(self) -> None:
        """Build the core objects; OffradarError leaves the node unconfigured."""

    def activated(self) -> None:
        """Called when the node has become active."""

    def deactivating(self) -> None:
        """Called when inputs are ignored already, while outputs can still be published."""

    def close(self) -> None:
        """Release the core objects; OffradarError, with nothing released, if that would lose something."""

    def rescue(self) -> str:
        """Called at exit when `close` has failed: keep what would be lost; says how in one line, or OffradarError."""
        return ''

    def apply(self, config: Config) -> None:
        """Take over parameters that were changed at run time."""
        self.config = config

    def periodic(self) -> None:
        """Called once a second while active."""

    def troubles(self) -> Iterator[Trouble]:
        """Why the node does not do its work, once a second while active; inputs that are silent are known already."""
        yield from ()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        if not (self._attempt(partial(parameters.require_files, self.config)) and self._attempt(self.configure)):
            # What it had made before it failed.
            self._attempt(self.close)
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        result = super().on_activate(state)
        self.active = True
        for each in self._inputs:
            each.watch.restart()
        if not self._attempt(self.activated):
            self.active = False
            super().on_deactivate(state)
            return TransitionCallbackReturn.FAILURE
        # These were sent once, maybe while this node was inactive, and are still valid.
        for handle_again in [again for kept in self._latched.values() for again in (kept.handled, kept.later)]:
            if handle_again is not None:
                handle_again()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        self.active = False
        if not self._attempt(self.deactivating):
            self.active = True
            return TransitionCallbackReturn.FAILURE
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        return super().on_cleanup(state) if self._attempt(self.close) else TransitionCallbackReturn.FAILURE

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        self.active = False
        return super().on_shutdown(state) if self._attempt(self.close) else TransitionCallbackReturn.FAILURE

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Lifecycle transition; FAILURE, and the node as it was, if it would lose something.

        Asked before the transition: one that fails would end the node all the same.
        """
        was_active, self.active = self.active, False
        if not self._attempt(self.close):
            self.active = was_active
            return TransitionCallbackReturn.FAILURE
        result: TransitionCallbackReturn = super().trigger_shutdown()
        return result

    def _attempt(self, work: Callable[[], None]) -> bool:
        """Do a part of a transition; False, with the error kept or logged, if it fails."""
        try:
            work()
        except Exception as error:
            if self._failure is None or not self._starting:
                self._failure = error
            if not self._starting and self.context.ok():
                self.get_logger().error(explain(error) or traceback.format_exc())
            return False
        return True

    def publisher(
        self, message_type: type[MessageT], topic: str, profile: QoSProfile, *, is_shared: bool = False
    ) -> Publisher:
        """A lifecycle publisher whose quality of service can be overridden by parameters.

        Who else publishes a topic that `is_shared` is no rival.
        """
        publisher: Publisher = self.create_lifecycle_publisher(
            # rclpy writes overrides into the profile that it is given, which other publishers share.
            message_type,
            topic,
            copy.copy(profile),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._outputs.append(publisher)
        if is_shared:
            self._shared.add(publisher.topic_name)
        package = message_type.__module__.partition('.')[0]
        self._output_types[publisher.topic_name] = f'{package}/msg/{message_type.__name__}'
        return publisher

    def subscribe(
        self,
        message_type: type[MessageT],
        topic: str,
        profile: QoSProfile,
        handle: Callable[[MessageT], None],
        *,
        ledger: Ledger | None = None,
        source: str = '',
        instead: Mapping[str, str] | None = None,
        is_needed: Callable[[], bool] = lambda: True,
        check: Callable[[MessageT], object] = lambda _message: None,
    ) -> Input:
        """An input whose callback is `guarded`.

        With a `ledger`, messages that never arrive are counted there and as `lost_before_arrival`, and those that come
        while the node is inactive as `inactive`, or that `handle` fails at as `refused`; it must settle the others.
        `check` raises RefusedInput for a latched message that can never be handled: it is not kept for when the node
        is active. The other arguments are those of `Input`.
        """
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        if ledger:
            self.ledgers.append(ledger)

        # rclpy gives the second argument, with the publisher's number of the message, to callbacks that take two.
        def receive(message: MessageT, info: Mapping[str, Any]) -> None:
            received_s = time.monotonic()
            if ledger:
                self._book(ledger, topic, lost.arrived(info, _stamp_of(message)))
            if self.active:
                found.watch.received()
            handled = self.active and self.guarded(topic, lambda: handle(message))
            if latched and (handled or self._may_be_handled(topic, lambda: check(message))):
                kept = _Latched() if handled else self._latched.get(topic, _Latched())
                again = partial(receive, message, info)
                self._latched[topic] = dataclasses.replace(kept, **{'handled' if handled else 'later': again})
            if ledger and not handled:
                ledger.settle('refused' if self.active else 'inactive')
            if handled and topic == self.timed_topic:
                self.status.handle(received_s)

        found = Input(
            self, message_type, topic, profile, cast(Any, receive), source=source, instead=instead, is_needed=is_needed
        )
        lost = LostMessages(found.count_audible)
        self._inputs.append(found)
        return found

    def _may_be_handled(self, topic: str, check: Callable[[], object]) -> bool:
        """Whether `check` accepts a message of `topic` that was not handled."""
        if not self.active:
            return self.guarded(topic, check)
        # It has been refused, and counted.
        with contextlib.suppress(Exception):
            check()
            return True
        return False

    def _book(self, ledger: Ledger, topic: str, lost: int) -> None:
        """One message of `topic` arrived, after `lost` that did not."""
        ledger.receive()
        if lost:
            ledger.lose(lost)
            problem = f'{lost} messages before this one were lost on the way: they come faster than they are taken up'
            self.refuse(RefusedInput('lost_before_arrival', problem), topic, lost)

    def guarded(self, topic: str, work: Callable[[], object]) -> bool:
        """Do `work` for a message of `topic`; an error is counted and logged, never raised. True if there was none."""
        try:
            work()
        except RefusedInput as problem:
            self.refuse(problem, topic)
        except Exception as error:
            # Work that was interrupted by a shutdown cannot publish any more.
            if text := explain(error):
                self.refuse(RefusedInput('not_possible', text), topic)
            elif self.context.ok():
                self.refuse(RefusedInput('internal_error', traceback.format_exc()), topic)
        else:
            return True
        return False

    async def pause(self, seconds: float) -> None:
        """Let other callbacks run meanwhile; for a service in a reentrant callback group."""
        elapsed = Future()
        timer = self.create_timer(
            seconds,
            partial(elapsed.set_result, None),
            ReentrantCallbackGroup(),
            Clock(clock_type=ClockType.STEADY_TIME),
        )
        await elapsed
        self.destroy_timer(timer)

    def log_info(self, text: str) -> None:
        """Log a line; at exit, when rclpy cannot log any more, print it."""
        if self.context.ok():
            self.get_logger().info(text)
        else:
            # The terminal may be gone: what is done at exit is done all the same.
            with contextlib.suppress(OSError, ValueError):
                print(f'[{self.get_name()}]: {text}', flush=True)

    def log_now_and_then(self, text: str) -> None:
        """Log a line at most once in 5 s."""
        now_s = time.monotonic()
        if now_s - self._last_logged_s.get(text, -LOG_PERIOD_S) >= LOG_PERIOD_S:
            self._last_logged_s[text] = now_s
            self.log_info(text)

    def refuse(self, problem: RefusedInput, topic: str, count: int = 1) -> None:
        """Count a drop, or `count` of them, and log the reason, each cause at most once in 5 s."""
        self.status.drop(problem.cause, str(problem), count)
        now_s = time.monotonic()
        if self.context.ok() and now_s - self._last_logged_s.get(problem.cause, -LOG_PERIOD_S) >= LOG_PERIOD_S:
            self._last_logged_s[problem.cause] = now_s
            self.get_logger().warning(f'{topic}: {problem}')

    def use_sim_time(self) -> bool:
        """Whether the node's clock is that of `/clock`."""
        return bool(self.get_parameter('use_sim_time').value)

    def now_ns(self) -> int:
        """The node's clock: simulated under use_sim_time."""
        return int(self.get_clock().now().nanoseconds)

    def _validate_parameters(self, updates: list[Parameter]) -> SetParametersResult:
        try:
            return parameters.validate(self.config, updates)
        except Exception as error:
            self.refuse(RefusedInput('internal_error', traceback.format_exc()), 'parameters')
            return SetParametersResult(successful=False, reason=f'internal error: {error!r}')

    def _apply_parameters(self, updates: list[Parameter]) -> None:
        self.guarded('parameters', lambda: self.apply(parameters.changed(self.config, updates)))

    def _report(self) -> None:
        if not self.context.ok():
            return
        for each in self._inputs:
            self.guarded(each.topic, partial(self._follow, each))
        found: list[Trouble] = []
        if self.active:
            self.guarded('periodic', self.periodic)
            self.guarded('troubles', lambda: found.extend(self._all_troubles()))
            self._log(found)
        for ledger in self.ledgers:
            self.status.facts |= ledger.values()
        self._diagnostics.publish(self.status.message(self.now_ns(), found))

    def _follow(self, each: Input) -> None:
        overridden = f'qos_overrides.{each.subscription.topic_name}.subscription.reliability' in self._overridden
        if line := each.follow_publishers(overridden):
            self.get_logger().warning(line)

    def _all_troubles(self) -> Iterator[Trouble]:
        for each in self._inputs:
            yield from filter(None, (each.trouble(), each.rival_sources()))
        if self.use_sim_time() and not self.now_ns():
            yield Trouble(
                'no_clock',
                'use_sim_time is true, and nothing came on /clock: start who publishes it (ros2 bag play --clock, a '
                'simulator), or set use_sim_time to false',
            )
        own = [output.topic_name for output in self._outputs if output.topic_name not in self._shared]
        for other, topics in rivals(self, own).items():
            text = f'{other} publishes {topics} too: launched twice? Stop one ({LISTED})'
            yield Trouble(f'rival.{other.rpartition(" ")[2]}', text)
        for topic, types in foreign_types(self, self._output_types).items():
            text = f'{topic} also carries {types}, of somebody else: remap ours (-r {full_name(self)}:{topic}:=NAME)'
            yield Trouble(f'foreign_type.{topic.lstrip("/")}', text)
        yield from self.troubles()

    def _log(self, troubles: list[Trouble]) -> None:
        """Log a trouble when it begins."""
        now_s = time.monotonic()
        for trouble in troubles:
            known = f'trouble {trouble.cause} {trouble.is_error}'
            if now_s - self._last_logged_s.get(known, -TROUBLE_PERIOD_S) >= TROUBLE_PERIOD_S:
                # On two lines: rclpy refuses another severity from the same one.
                if trouble.is_error:
                    self.get_logger().error(trouble.text)
                else:
                    self.get_logger().warning(trouble.text)
            # It is not logged again while it lasts.
            self._last_logged_s[known] = now_s
