"""Genuine ROS 2 (rclpy) as the other side of our trials: says what it saw, one line each.

peer.py topics N      publishes 1..N on to_ours, counts what comes back on from_ours
peer.py late          publishes three latched texts, and takes those that were there before it
peer.py graph         says the nodes, types and hashes that it sees, and when they are gone
peer.py nodes         has two nodes, destroys one at 1 on /go, and leaves at 2
peer.py client N      asks twice N times
peer.py serve         has parameters and the service twice; runs until it is killed
peer.py ask NODE      sets and gets the parameters of NODE
peer.py action_client N, action_server, images N, manage N, managed, logs NODE, hashes FILE, watch, moves N,
diagnostics, simulate, events: in the files beside this one
"""

import sys
import time

import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32, String
from test_msgs.srv import BasicTypes


def say(*words):
    print(*words, flush=True)


def until(node, done, seconds=50):
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            say("timeout")
            sys.exit(1)
        rclpy.spin_once(node, timeout_sec=0.05)


def topics(node, count):
    for kind in ("reliable", "best_effort"):
        policy = getattr(ReliabilityPolicy, kind.upper())
        qos = QoSProfile(depth=500, reliability=policy)
        first, seen = [], []
        out = node.create_publisher(Int32, f"{kind}_to_ours", qos)

        def hear(m):
            # Where the network loses some, a late one of the first may come until the numbers begin.
            (seen if m.data or seen else first).append(m.data)

        node.create_subscription(Int32, f"{kind}_from_ours", hear, qos)

        # Both sides know each other once something has come back; then until nothing more comes.
        while not first:
            out.publish(Int32(data=0))
            rclpy.spin_once(node, timeout_sec=0.1)
        quiet = time.monotonic()
        while time.monotonic() - quiet < 1:
            before = len(first)
            rclpy.spin_once(node, timeout_sec=0.1)
            quiet = quiet if len(first) == before else time.monotonic()
        for number in range(1, count + 1):
            out.publish(Int32(data=number))
            rclpy.spin_once(node, timeout_sec=0.002)
        until(node, lambda: len(seen) >= count)
        for _ in range(10):
            rclpy.spin_once(node, timeout_sec=0.05)
        say(kind, len(seen), seen == list(range(1, count + 1)))


def late(node):
    qos = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    seen = []
    out = node.create_publisher(String, "latched_to_ours", qos)
    for text in ("one", "two", "three"):
        out.publish(String(data=text))
    node.create_subscription(String, "latched_from_ours", lambda m: seen.append(m.data), qos)
    say("ready")
    until(node, lambda: len(seen) >= 3)
    say("late", *seen)
    while True:
        rclpy.spin_once(node, timeout_sec=0.5)


def graph(node):
    topics = {
        "publisher": lambda: node.get_publishers_info_by_topic("/ns/number"),
        "subscription": lambda: node.get_subscriptions_info_by_topic("/ns/text"),
    }
    for kind, look in topics.items():
        named = lambda: [i for i in look() if "UNKNOWN" not in i.node_name]
        until(node, named)
        info = named()[0]
        say(kind, info.node_namespace, info.node_name, info.topic_type, info.topic_type_hash)
    services = lambda: dict(node.get_service_names_and_types_by_node("ours", "/ns"))
    until(node, lambda: "/ns/ours/get_parameters" in services())
    say("service", *services()["/ns/ours/get_parameters"])
    names = lambda: [f"{at.rstrip('/')}/{name}" for name, at in node.get_node_names_and_namespaces()]
    say("node", "/ns/ours" in names(), "bare", "/ns/bare" in names())
    until(node, lambda: "/ns/bare" not in names())
    say("bare", "gone")
    until(node, lambda: not any(look() for look in topics.values()))
    say("gone")


def client(node, count):
    client = node.create_client(BasicTypes, "twice")
    until(node, client.service_is_ready)
    right = 0
    for number in range(count):
        text = f"text {number}"
        future = client.call_async(BasicTypes.Request(int64_value=number, string_value=text))
        until(node, future.done)
        answer = future.result()
        right += answer.int64_value == 2 * number and answer.string_value == text[::-1]
    say("answered", right)


def serve(node):
    def twice(request, response):
        response.int64_value = 2 * request.int64_value
        response.string_value = request.string_value[::-1]
        return response

    node.create_service(BasicTypes, "twice", twice)
    node.declare_parameter("gain", 3)
    say("ready")
    while True:
        rclpy.spin_once(node, timeout_sec=0.5)


def ask(node, name):
    client = AsyncParameterClient(node, name)
    until(node, client.services_are_ready)
    right = 0
    for number in range(100):
        future = client.set_parameters([Parameter("gain", value=number)])
        until(node, future.done)
        future = client.get_parameters(["gain"])
        until(node, future.done)
        right += future.result().values[0].integer_value == number
    say("asked", right)


rclpy.init()
mode, *rest = sys.argv[1:]
if mode == "managed":
    import peer_lifecycle

    peer_lifecycle.managed(say)
if mode == "nodes":
    import peer_graph

    peer_graph.nodes(say, until)
peer = rclpy.create_node("peer", namespace="/peer")
if mode == "topics":
    topics(peer, int(rest[0]))
elif mode == "client":
    client(peer, int(rest[0]))
elif mode == "ask":
    ask(peer, rest[0])
elif mode == "logs":
    import peer_logs

    peer_logs.logs(peer, rest[0], say, until)
elif mode == "simulate":
    import peer_simulation

    peer_simulation.simulate(peer, say, until)
elif mode == "events":
    import peer_events

    peer_events.events(peer, say, until)
elif mode == "diagnostics":
    import peer_diagnostics

    peer_diagnostics.diagnostics(peer, say, until)
elif mode == "action_client":
    import peer_actions

    peer_actions.action_client(peer, int(rest[0]), say, until)
elif mode == "action_server":
    import peer_actions

    peer_actions.action_server(peer, say)
elif mode == "images":
    import peer_large

    peer_large.images(peer, int(rest[0]), say, until)
elif mode == "hashes":
    import peer_graph

    peer_graph.hashes(peer, rest[0], say, until)
elif mode == "moves":
    import peer_graph

    peer_graph.moves(peer, int(rest[0]), say)
elif mode == "watch":
    import peer_graph

    peer_graph.watch(peer, say)
elif mode == "manage":
    import peer_lifecycle

    peer_lifecycle.manage(peer, int(rest[0]), say, until)
else:
    {"late": late, "graph": graph, "serve": serve}[mode](peer)
