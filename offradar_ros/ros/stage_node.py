"""What the three nodes share: lifecycle with autostart, parameters, diagnostics, and a guard against bad messages."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from offradar_ros.config import Config
from offradar_ros.errors import OffradarError, RefusedInput
from offradar_ros.ros import parameters, qos
from offradar_ros.ros.connections import serve_subscribers
from offradar_ros.ros.diagnostics import NodeStatus

MessageT = TypeVar('MessageT')
LOG_PERIOD_S = 5.0


class StageNode(LifecycleNode):
    """A lifecycle node around one stage of the core.

    Subclasses build their core objects in `configure`, which may raise OffradarError. Inputs are ignored unless the
    node is active.
    """

    parameter_groups: tuple[str, ...] = ()
    """The parts of the configuration whose parameters the node declares, such as ``query``."""
    timed_topic = ''
    """The input whose rate and latency the diagnostics report."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        overrides = options.get('parameter_overrides') or ()
        self.config = parameters.declare(self, Config(), self.parameter_groups, overrides)
        self._autostart = self.declare_parameter(
            'autostart', True, ParameterDescriptor(description='configure and activate at start', read_only=True)
        ).value
        self.add_on_set_parameters_callback(self._validate_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self.status = NodeStatus(f'{self.get_fully_qualified_name().lstrip("/")}: offradar_ros')
        self.active = False
        self._outputs: list[Publisher] = []
        self._latched: dict[str, Callable[[], None]] = {}
        self._failure: OffradarError | None = None
        self._last_logged_s: dict[str, float] = {}
        serve_subscribers(self, self._outputs)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', qos.RESULTS)
        # Diagnostics must go on while a paused replay holds the ROS clock.
        self._report_timer = self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Configure and activate, unless `autostart` is false; raises the error that prevented it."""
        if not self._autostart:
            return
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise self._failure or OffradarError(f'{self.get_name()}: could not be activated')

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

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        try:
            self.configure()
        except OffradarError as error:
            self._failure = error
            if not self._autostart:
                self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception:
            self.get_logger().error(traceback.format_exc())
            raise
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        result = super().on_activate(state)
        self.active = True
        self.activated()
        # These were sent once, maybe while this node was inactive, and are still valid.
        for handle_again in list(self._latched.values()):
            handle_again()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        self.active = False
        self.deactivating()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        return super().on_cleanup(state) if self._try_close() else TransitionCallbackReturn.FAILURE

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition."""
        self.active = False
        return super().on_shutdown(state) if self._try_close() else TransitionCallbackReturn.FAILURE

    def _try_close(self) -> bool:
        try:
            self.close()
        except OffradarError as error:
            self.get_logger().error(str(error))
            return False
        return True

    def publisher(self, message_type: type[MessageT], topic: str, profile: QoSProfile) -> Publisher:
        """A lifecycle publisher whose quality of service can be overridden by parameters."""
        publisher: Publisher = self.create_lifecycle_publisher(
            message_type, topic, profile, qos_overriding_options=QoSOverridingOptions.with_default_policies()
        )
        self._outputs.append(publisher)
        return publisher

    def subscribe(
        self, message_type: type[MessageT], topic: str, profile: QoSProfile, handle: Callable[[MessageT], None]
    ) -> Subscription:
        """A subscription whose callback is `guarded`."""

        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL

        def receive(message: MessageT) -> None:
            if latched:
                self._latched[topic] = lambda: receive(message)
            if not self.active:
                return
            received_s = time.monotonic()
            if self.guarded(topic, lambda: handle(message)) and topic == self.timed_topic:
                self.status.handle(received_s)

        return self.create_subscription(
            message_type,
            topic,
            receive,
            profile,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def guarded(self, topic: str, work: Callable[[], None]) -> bool:
        """Do `work` for a message of `topic`; an error is counted and logged, never raised. True if there was none."""
        try:
            work()
        except RefusedInput as problem:
            self.refuse(problem, topic)
        except OffradarError as error:
            self.refuse(RefusedInput('not_possible', str(error)), topic)
        except Exception:
            # Work that was interrupted by a shutdown cannot publish any more.
            if self.context.ok():
                self.refuse(RefusedInput('internal_error', traceback.format_exc()), topic)
        else:
            return True
        return False

    def log_info(self, text: str) -> None:
        """Log a line; at exit, when rclpy cannot log any more, print it."""
        if self.context.ok():
            self.get_logger().info(text)
        else:
            print(f'[{self.get_name()}]: {text}', flush=True)

    def refuse(self, problem: RefusedInput, topic: str) -> None:
        """Count a drop and log its reason, each cause at most once in 5 s."""
        self.status.drop(problem.cause)
        now_s = time.monotonic()
        if self.context.ok() and now_s - self._last_logged_s.get(problem.cause, -LOG_PERIOD_S) >= LOG_PERIOD_S:
            self._last_logged_s[problem.cause] = now_s
            self.get_logger().warning(f'{topic}: {problem}')

    def now_ns(self) -> int:
        """The node's clock: simulated under use_sim_time."""
        return int(self.get_clock().now().nanoseconds)

    def _validate_parameters(self, updates: list[Parameter]) -> SetParametersResult:
        return parameters.validate(self.config, updates)

    def _apply_parameters(self, updates: list[Parameter]) -> None:
        self.apply(parameters.changed(self.config, updates))

    def _report(self) -> None:
        if not self.context.ok():
            return
        if self.active:
            self.periodic()
        self._diagnostics.publish(self.status.message(self.now_ns()))
