"""The mode of peer.py about images of a megabyte."""

from array import array

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image


def images(node, count, say, until):
    qos = QoSProfile(depth=3, reliability=ReliabilityPolicy.RELIABLE)
    first, heard = [], []
    out = node.create_publisher(Image, "image_to_ours", qos)

    def hear(m):
        # Where the network loses some, a late one of the first may come until the numbers begin.
        (heard if m.height or heard else first).append(m)

    node.create_subscription(Image, "image_from_ours", hear, qos)

    def image(number):
        data = bytes((number * 31 + place) % 251 for place in range(10_000)) * 100
        return Image(height=number, encoding="mono8", data=array("B", data))

    # Both sides know each other once something has come back; then until nothing more comes.
    greeting = image(0)
    while not first:
        out.publish(greeting)
        for _ in range(10):
            rclpy.spin_once(node, timeout_sec=0.1)
    quiet = 0
    while quiet < 10:
        before = len(first)
        rclpy.spin_once(node, timeout_sec=0.1)
        quiet = quiet + 1 if len(first) == before else 0
    right = 0
    for number in range(1, count + 1):
        sent = image(number)
        out.publish(sent)
        until(node, lambda: len(heard) >= number)
        right += heard[-1] == sent
    for _ in range(10):
        rclpy.spin_once(node, timeout_sec=0.05)
    say("images", right, "of", len(heard))
