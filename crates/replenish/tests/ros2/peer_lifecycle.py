"""The modes of peer.py about managed nodes."""

import rclpy
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile

# Configure, activate, deactivate, clean up: the transition, and the state that it leads to.
ROUND = [(1, 2), (3, 3), (4, 2), (2, 1)]


def manage(node, rounds, say, until):
    events = []
    qos = QoSProfile(depth=100)
    node.create_subscription(TransitionEvent, "ours/transition_event", events.append, qos)
    clients = {}

    def ask(kind, service, request):
        if service not in clients:
            clients[service] = node.create_client(kind, f"ours/{service}")
            until(node, clients[service].service_is_ready)
        future = clients[service].call_async(request)
        until(node, future.done)
        return future.result()

    def change(id):
        request = ChangeState.Request(transition=Transition(id=id))
        return ask(ChangeState, "change_state", request).success

    publishers = lambda: node.count_publishers("/peer/ours/transition_event")
    until(node, publishers)
    right = 0
    for _ in range(rounds):
        for id, to in ROUND:
            changed = change(id)
            state = ask(GetState, "get_state", GetState.Request()).current_state.id
            right += changed and state == to
    say("changed", right, "of", rounds * len(ROUND))
    until(node, lambda: len(events) >= 2 * rounds * len(ROUND))
    say("events", len(events))
    say("refused", not change(3))
    states = ask(GetAvailableStates, "get_available_states", GetAvailableStates.Request())
    which = GetAvailableTransitions
    now = ask(which, "get_available_transitions", which.Request()).available_transitions
    every = ask(which, "get_transition_graph", which.Request()).available_transitions
    say("states", len(states.available_states), "transitions", len(now), "graph", len(every))


def managed(say):
    camera = LifecycleNode("camera", namespace="/peer")
    say("ready")
    rclpy.spin(camera)
