"""The one table of states: complete, without dead ends, and what the strategies really do."""

from collections import deque

from lwrprobe_strategies.states import TRANSITIONS, Event, State


def reachable_from(state, table):
    seen, queue = {state}, deque([state])
    while queue:
        now = queue.popleft()
        for (before, _), after in table.items():
            if before is now and after not in seen:
                seen.add(after)
                queue.append(after)
    return seen


def test_every_state_is_entered_and_the_end_is_reached_from_each():
    # A threat is answered by the strategy: it may lead to any of these.
    table = TRANSITIONS | {(State.CONTOUR, Event.THREAT): State.RETREAT}
    assert reachable_from(State.TRANSFER, table) == set(State)
    for state in State:
        assert State.FINISHED in reachable_from(state, table), state


def test_an_overlarge_force_is_answered_in_every_state_that_moves():
    moving = set(State) - {State.FINISHED, State.RELEASE}
    assert {state for state, event in TRANSITIONS if event is Event.OVERLOAD} == moving


def test_events_but_threats_are_all_in_the_table():
    assert {event for _, event in TRANSITIONS} == set(Event) - {Event.THREAT}
