"""Genuine ROS 2: says each number that it hears on /chatter, best effort, and once "publisher TYPE HASH"
as the graph shows them. Runs until it is killed."""

import rclpy
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Int32

rclpy.init()
node = rclpy.create_node("listener")
node.create_subscription(Int32, "/chatter", lambda m: print(m.data, flush=True), qos_profile_sensor_data)
said = False
while True:
    rclpy.spin_once(node, timeout_sec=0.05)
    publishers = [] if said else node.get_publishers_info_by_topic("/chatter")
    for info in publishers[:1]:
        said = True
        print("publisher", info.topic_type, info.topic_type_hash, flush=True)
