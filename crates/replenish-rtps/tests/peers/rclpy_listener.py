"""Genuine ROS 2: says each number that it hears on /chatter, best effort. Runs until it is killed."""

import rclpy
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Int32

rclpy.init()
node = rclpy.create_node("listener")
node.create_subscription(Int32, "/chatter", lambda m: print(m.data, flush=True), qos_profile_sensor_data)
rclpy.spin(node)
