"""Every transition is answered in every state, and one that is refused or fails leaves the node as it was."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from live_nodes import Observer, StartNode
from std_srvs.srv import Trigger

from offradar_ros.errors import MapError
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros.stage_node import StageNode

UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
WAY = {UNCONFIGURED: (), INACTIVE: (CONFIGURE,), ACTIVE: (CONFIGURE, ACTIVATE)}
"""The transitions that lead from the start to a state."""
LEADS_TO = {
    (UNCONFIGURED, CONFIGURE): INACTIVE,
    (INACTIVE, CLEANUP): UNCONFIGURED,
    (INACTIVE, ACTIVATE): ACTIVE,
    (ACTIVE, DEACTIVATE): INACTIVE,
    (UNCONFIGURED, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN): FINALIZED,
    (INACTIVE, Transition.TRANSITION_INACTIVE_SHUTDOWN): FINALIZED,
    (ACTIVE, Transition.TRANSITION_ACTIVE_SHUTDOWN): FINALIZED,
}
KINDS = {'encoder': EncoderNode, 'map_server': MapServerNode, 'query': QueryNode}


class Asked:
    """A node that does not start by itself, and what it answers."""

    def __init__(self, observer: Observer, start_node: StartNode, name: str) -> None:
        self._observer, self._name = observer, name
        self.node: StageNode = start_node(KINDS[name], {'autostart': False})

    def change(self, number: int, label: str = '') -> bool:
        request = ChangeState.Request(transition=Transition(id=number, label=label))
        return bool(self._observer.call(ChangeState, f'{self._name}/change_state', request).success)

    @property
    def state(self) -> int:
        return int(self._observer.call(GetState, f'{self._name}/get_state', GetState.Request()).current_state.id)

    def lead_to(self, state: int) -> None:
        for transition in WAY[state]:
            assert self.change(transition)
        assert self.state == state


@pytest.fixture
def ask(observer: Observer, start_node: StartNode) -> Callable[[str], Asked]:
    return lambda name: Asked(observer, start_node, name)


@pytest.mark.parametrize('name', KINDS)
@pytest.mark.parametrize('state', WAY)
def test_a_transition_that_is_not_possible_is_refused(ask: Callable[[str], Asked], name: str, state: int) -> None:
    asked = ask(name)
    asked.lead_to(state)
    for number in (*range(20), 30, 40, 50, 60, 61, 62, 99, 255):
        if (state, number) not in LEADS_TO:
            assert not asked.change(number), number
            assert asked.state == state
            assert asked.node.active == (state == ACTIVE)
    for label in ('transition_success', 'nonsense', 'ünïcode', 'x' * 10_000):
        assert not asked.change(CONFIGURE, label)
        assert asked.state == state


@pytest.mark.parametrize('name', KINDS)
@pytest.mark.parametrize(('state', 'number'), LEADS_TO)
def test_a_transition_that_is_possible_is_done(ask: Callable[[str], Asked], name: str, state: int, number: int) -> None:
    asked = ask(name)
    asked.lead_to(state)
    assert asked.change(number)
    assert asked.state == LEADS_TO[state, number]
    assert asked.node.active == (asked.state == ACTIVE)


def test_labels_name_transitions_as_numbers_do(ask: Callable[[str], Asked]) -> None:
    asked = ask('query')
    for label, state in {
        'configure': INACTIVE,
        'activate': ACTIVE,
        'deactivate': INACTIVE,
        'shutdown': FINALIZED,
    }.items():
        assert asked.change(0, label)
        assert asked.state == state
    assert not any(asked.change(number) for number in range(9))
    assert asked.state == FINALIZED


STEPS = {
    'configure': (UNCONFIGURED, CONFIGURE),
    'activated': (INACTIVE, ACTIVATE),
    'deactivating': (ACTIVE, DEACTIVATE),
}
"""Which transition calls what of a node, and from which state."""


@pytest.mark.parametrize('name', KINDS)
@pytest.mark.parametrize(
    ('step', 'error'),
    [*itertools.product(STEPS, [ZeroDivisionError(), MapError('no'), PermissionError(13, 'no', '/x'), MemoryError()])],
)
def test_a_transition_that_fails_leaves_the_node_as_it_was(
    ask: Callable[[str], Asked], monkeypatch: pytest.MonkeyPatch, name: str, step: str, error: Exception
) -> None:
    asked = ask(name)
    state, number = STEPS[step]
    asked.lead_to(state)

    def fail() -> None:
        # Anew: one that is raised keeps the frames, and so this test's nodes, for as long as the parameter lives.
        raise copy.copy(error)

    with monkeypatch.context() as patch:
        patch.setattr(asked.node, step, fail)
        assert not asked.change(number)
    assert asked.state == state
    assert asked.node.active == (state == ACTIVE)
    assert asked.change(number)
    assert asked.state == LEADS_TO[state, number]


@pytest.mark.parametrize('state', [INACTIVE, ACTIVE])
def test_what_would_lose_something_is_not_done(
    ask: Callable[[str], Asked], observer: Observer, monkeypatch: pytest.MonkeyPatch, state: int
) -> None:
    asked = ask('map_server')
    asked.lead_to(ACTIVE)
    if state == INACTIVE:
        assert asked.change(DEACTIVATE)
    shutdown = Transition.TRANSITION_ACTIVE_SHUTDOWN if state == ACTIVE else Transition.TRANSITION_INACTIVE_SHUTDOWN

    def fail() -> None:
        raise MapError('the disk is full')

    with monkeypatch.context() as patch:
        patch.setattr(asked.node, 'close', fail)
        assert not asked.change(shutdown)
        assert asked.state == state
        assert asked.node.active == (state == ACTIVE)
    assert observer.call(Trigger, 'map_server/end_session', Trigger.Request()).success
    assert asked.change(shutdown)
    assert asked.state == FINALIZED
