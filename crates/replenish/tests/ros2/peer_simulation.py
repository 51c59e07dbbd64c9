"""The mode of peer.py that is a simulator: it drives /clock, backwards too."""

import time

import rclpy
from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from test_msgs.srv import Empty

# The time, in seconds, and how many beats the other side must have said before the next one.
STEPS = [(100.0, 0), (100.9, 0), (101.0, 1), (105.5, 2), (50.0, 2), (50.999, 2), (51.0, 3), (52.25, 4)]


def simulate(node, say, until):
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    clock = node.create_publisher(Clock, "/clock", best_effort)
    beats, now = [], []
    seconds = lambda stamp: stamp.sec + round(stamp.nanosec / 1e9, 6)
    node.create_subscription(Time, "beats", lambda stamp: beats.append(seconds(stamp)), 10)
    node.create_subscription(Time, "now", lambda stamp: now.append(seconds(stamp)), 10)
    until(node, lambda: now)  # both sides know each other
    until(node, lambda: node.get_subscriptions_info_by_topic("/clock"))
    until(node, lambda: node.count_publishers("beats"))
    for at, count in STEPS:
        nanoseconds = round(at * 1e9)
        stamp = Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

        def told():
            if now and now[-1] == at:
                return True
            clock.publish(Clock(clock=stamp))
            return False

        until(node, told)
        until(node, lambda: len(beats) >= count)
    end = time.monotonic() + 0.5  # a beat too many would come now
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
    say("beats", beats)
    names = node.get_node_names_and_namespaces()
    say("node", ("rover", "/sim") in names, any(name == "arm" for name, _ in names))
    types = dict(node.get_topic_names_and_types())
    say(*(word for name in ("/peer/beats", "/peer/now") for word in (name, types[name])))
    reset = node.create_client(Empty, "/peer/reset")
    until(node, reset.service_is_ready)
    future = reset.call_async(Empty.Request())
    until(node, future.done)
    say("/peer/reset", future.result() == Empty.Response())
    while True:
        rclpy.spin_once(node, timeout_sec=0.5)
