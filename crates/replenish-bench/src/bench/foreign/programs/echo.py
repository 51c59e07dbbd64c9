"""Genuine ROS 2, the other side of trips.py: sends every string of /ping back on /pong."""

import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("echo")
pong = node.create_publisher(String, "/pong", 10)
node.create_subscription(String, "/ping", pong.publish, 10)
print("ready", flush=True)
rclpy.spin(node)
