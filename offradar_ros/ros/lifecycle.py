"""A lifecycle node that no request ends: what cannot be done is answered, and leaves the node as it was."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.service import Service

from offradar_ros.entry_point import explain
from offradar_ros.ros import qos

_SHUTDOWNS = (
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    Transition.TRANSITION_INACTIVE_SHUTDOWN,
    Transition.TRANSITION_ACTIVE_SHUTDOWN,
)


class SteadyLifecycleNode(LifecycleNode):
    """A LifecycleNode whose services always answer.

    rclpy raises in the executor where a transition is not possible or a service fails, which ends a process that spins
    the node, without an answer to whoever asked.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._service_change_state.callback = self._answer_change_state

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any
    ) -> Service:
        """As in rclpy; a callback that raises is answered, with `success` false and the reason where there are such."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                return self._failed(srv_name, error, response)

        async def answer_later(request: Any, response: Any) -> Any:
            try:
                return await callback(request, response)
            except Exception as error:
                return self._failed(srv_name, error, response)

        options.setdefault('qos_profile', qos.SERVICES)
        chosen = answer_later if inspect.iscoroutinefunction(callback) else answer
        return super().create_service(srv_type, srv_name, chosen, **options)

    def _failed(self, service: str, error: Exception, response: Any) -> Any:
        text = explain(error) or f'internal error: {error!r}'
        if self.context.ok():
            self.get_logger().error(f'service {service}: {explain(error) or traceback.format_exc()}')
        if hasattr(response, 'success'):
            response.success = False
        if hasattr(response, 'message'):
            response.message = text
        return response

    def _answer_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Do a transition that is possible now; the label counts, if there is one, as in rclpy."""
        label, number = request.transition.label, request.transition.id
        possible = {each[0]: each[1] for each in self._state_machine.available_transitions}
        if label:
            number = next((known for known, name in possible.items() if name == label), -1)
        steps = {
            Transition.TRANSITION_CONFIGURE: self.trigger_configure,
            Transition.TRANSITION_CLEANUP: self.trigger_cleanup,
            Transition.TRANSITION_ACTIVATE: self.trigger_activate,
            Transition.TRANSITION_DEACTIVATE: self.trigger_deactivate,
            **dict.fromkeys(_SHUTDOWNS, self.trigger_shutdown),
        }
        if number in possible and number in steps:
            response.success = steps[number]() == TransitionCallbackReturn.SUCCESS
        else:
            state = self._state_machine.current_state[1]
            asked = f'{label!r}' if label else f'{number}'
            allowed = ', '.join(f'{name} ({known})' for known, name in sorted(possible.items()) if known in steps)
            self.get_logger().warning(
                f'transition {asked} is refused: the node is {state}; possible now: {allowed or "none"}'
            )
            response.success = False
        return response
