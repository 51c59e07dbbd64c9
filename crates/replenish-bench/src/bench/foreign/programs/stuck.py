"""Genuine ROS 2: a talker and a listener in one node, whose callback never returns. It begins with
the first line on standard input."""

import sys

import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("stuck")
talker = node.create_publisher(String, "/stuck", 10)


def stuck(_):
    print("stuck", flush=True)
    while True:
        pass


node.create_subscription(String, "/stuck", stuck, 10)
print("ready", flush=True)
sys.stdin.readline()
node.create_timer(0.05, lambda: talker.publish(String(data="go")))
rclpy.spin(node)
