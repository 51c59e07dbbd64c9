"""The modes of peer.py about what the graph shows, and when."""

import json
import os
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Int32, String


def genuine(kind):
    """The hash that this distribution has for a type; none if it lacks the package or the type."""
    package, _, name = kind.split("/")
    path = os.path.join(sys.prefix, "share", package, "msg", f"{name}.json")
    if not os.path.exists(path):
        return None
    with open(path) as file:
        hashes = json.load(file)["type_hashes"]
    return next(each["hash_string"] for each in hashes if each["type_name"] == kind)


def hashes(node, file, say, until):
    with open(file) as lines:
        wanted = [line.split() for line in lines]
    say("ready")

    def right(topic, kind, hash):
        found = node.get_publishers_info_by_topic(topic)
        return any(
            info.node_name == "ours"
            and info.topic_type == kind
            and str(info.topic_type_hash) == hash
            for info in found
        )

    left = list(wanted)

    def all_seen():
        left[:] = [each for each in left if not right(*each)]
        return not left

    until(node, all_seen)
    say("seen", len(wanted))
    known = [(kind, hash, genuine(kind)) for _, kind, hash in wanted]
    known = [(kind, hash, other) for kind, hash, other in known if other]
    differ = [kind for kind, hash, other in known if hash != other]
    say("genuine", len(known), "differ", *differ)


def nodes(say, until):
    """Two nodes of one participant, of which one goes, and then the participant."""
    first = rclpy.create_node("peer")
    second = rclpy.create_node("second", namespace="/peer/deep")
    second.create_publisher(Int32, "number", 10)
    second.create_subscription(String, "text", lambda m: None, 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    heard = [0]
    first.create_subscription(Int32, "/go", lambda m: heard.append(m.data), latched)
    say("ready")
    until(first, lambda: heard[-1] == 1)
    second.destroy_node()
    say("destroyed")
    until(first, lambda: heard[-1] == 2)
    say("leaves")
    first.destroy_node()
    rclpy.shutdown()
    sys.exit(0)


def moves(node, count, say):
    """Asks and hears something in rounds, after each of which the other side gets another address."""
    for number in range(1, count + 1):
        heard, answers = [], []
        ping = node.create_publisher(Int32, "ping", 10)
        numbers = node.create_subscription(Int32, "number", lambda m: heard.append(m.data), 100)
        pongs = node.create_subscription(Int32, "pong", lambda m: answers.append(m.data), 10)
        while not heard or number not in answers:
            ping.publish(Int32(data=number))
            rclpy.spin_once(node, timeout_sec=0.05)
        for old in (numbers, pongs):
            node.destroy_subscription(old)
        node.destroy_publisher(ping)
        say("answered", number)
        # Until it has the other address; what is made after that has to be found.
        time.sleep(1)
    while True:
        rclpy.spin_once(node, timeout_sec=0.5)


def watch(node, say):
    """Says when the other side is seen, heard, answers, and is gone; and samples out of order."""
    heard, answers = [], []
    ping = node.create_publisher(Int32, "ping", 10)
    node.create_subscription(Int32, "number", lambda m: heard.append(m.data), 100)
    node.create_subscription(Int32, "pong", lambda m: answers.append(m.data), 10)
    last, number, said = 0, 0, "gone"
    while True:
        rclpy.spin_once(node, timeout_sec=0.02)
        seen = any(info.node_name == "ours" for info in node.get_publishers_info_by_topic("number"))
        for value in heard:
            if value <= last:
                say("again", value, "after", last)
            last = value
        news, asked = bool(heard), bool(answers)
        heard.clear()
        if not seen and said != "gone":
            said = "gone"
            say("gone")
        elif seen and said == "gone":
            said = "seen"
            say("seen")
        if said == "seen" and news:
            said = "heard"
            say("heard")
            answers.clear()
            asked, number = False, number + 1
            asked_at = 0
        if said == "heard":
            # The other side may find our publisher later than we its own.
            if time.monotonic() - asked_at > 0.1:
                asked_at = time.monotonic()
                ping.publish(Int32(data=number))
            if number in answers:
                said = "answered"
                say("answered")
        if said == "answered":
            answers.clear()
