"""Genuine ROS 2: sends every string of /ping and /latched back on /pong, on loopback.

Prints "ready", and "publisher NODE TYPE HASH" and "subscription NODE TYPE HASH" when the graph shows
the other side's endpoints with the name of their node. Runs until it is killed; "gone" when the
publisher of /ping has disappeared again.
"""

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("echo", namespace="/peer")
pong = node.create_publisher(String, "/pong", 200)
node.create_subscription(String, "/ping", pong.publish, 200)
latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
kept = []
node.create_subscription(String, "/latched", kept.append, latched)
print("ready", flush=True)
said = {}
while True:
    rclpy.spin_once(node, timeout_sec=0.05)
    # Not before its reader is known: /pong is volatile.
    if pong.get_subscription_count() > 0:
        while kept:
            pong.publish(kept.pop(0))
    seen = {
        "publisher": node.get_publishers_info_by_topic("/ping"),
        "subscription": node.get_subscriptions_info_by_topic("/pong"),
    }
    for kind, found in seen.items():
        for info in found:
            if "UNKNOWN" not in info.node_name and kind not in said:
                said[kind] = True
                hash = info.topic_type_hash
                print(kind, info.node_name, info.topic_type, hash, flush=True)
    if "publisher" in said and not seen["publisher"]:
        print("gone", flush=True)
        said.clear()
