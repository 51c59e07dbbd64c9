"""rclpy as the end that hears of QoS events, and as the one that breaks its promises."""

import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSProfile
from std_msgs.msg import Int32


def profile(**promises):
    return QoSProfile(depth=10, **promises)


DEADLINE = profile(deadline=Duration(nanoseconds=200_000_000))
MANUAL = profile(
    liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    liveliness_lease_duration=Duration(nanoseconds=1_000_000_000),
)
AUTOMATIC = profile(liveliness_lease_duration=Duration(nanoseconds=3_000_000_000))


class Last:
    """The last event of each kind of one endpoint."""

    def __init__(self):
        self.events = {}

    def keep(self, kind):
        return lambda event: self.events.__setitem__(kind, event)

    def get(self, kind, field):
        return getattr(self.events.get(kind), field, 0)


def events(node, say, until):
    kinds = ("deadline", "liveliness", "matched")

    def listen(topic, qos):
        last = Last()
        callbacks = SubscriptionEventCallbacks(**{kind: last.keep(kind) for kind in kinds})
        node.create_subscription(Int32, topic, lambda _: None, qos, event_callbacks=callbacks)
        return last

    def offer(topic, qos):
        last = Last()
        callbacks = PublisherEventCallbacks(**{kind: last.keep(kind) for kind in kinds})
        return last, node.create_publisher(Int32, topic, qos, event_callbacks=callbacks)

    # Of ours: a deadline that is missed, a silent one that is manual, a quiet one that is not.
    missed = listen("deadline_from_ours", DEADLINE)
    silent = listen("manual_from_ours", MANUAL)
    quiet = listen("automatic_from_ours", AUTOMATIC)
    automatic, _quiet = offer("automatic_to_ours", AUTOMATIC)
    until(node, lambda: missed.get("deadline", "total_count") >= 3)
    say("deadline missed")
    until(node, lambda: silent.get("liveliness", "not_alive_count") == 1)
    say("silent", silent.get("liveliness", "alive_count"))
    until(node, lambda: silent.get("liveliness", "alive_count") == 1)
    say("back", silent.get("liveliness", "not_alive_count"))
    # Longer than its lease, twice.
    end = node.get_clock().now() + Duration(seconds=7)
    until(node, lambda: node.get_clock().now() > end)
    say("quiet", quiet.get("liveliness", "alive_count"), quiet.get("liveliness", "not_alive_count"))

    # Of rclpy, for ours.
    deadline, of_deadline = offer("deadline_to_ours", DEADLINE)
    manual, of_manual = offer("manual_to_ours", MANUAL)
    offers = (deadline, manual, automatic)
    until(node, lambda: all(last.get("matched", "current_count") == 1 for last in offers))
    of_deadline.publish(Int32(data=1))
    of_manual.publish(Int32(data=1))
    until(node, lambda: manual.get("liveliness", "total_count") >= 1)
    say("lost")
    until(node, lambda: deadline.get("deadline", "total_count") >= 3)
    say("missed")
    while True:
        rclpy.spin_once(node, timeout_sec=0.5)
