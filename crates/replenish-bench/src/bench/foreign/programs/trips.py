"""Genuine ROS 2: of every line N on standard input it makes N round trips, one every 10 ms, over
/ping and /pong, and prints how long each took, in ns. A trip that takes longer than 2 s counts as
2 s."""

import sys
import time

import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("trips")
ping = node.create_publisher(String, "/ping", 10)
heard = {}


def back(message):
    heard[message.data] = time.monotonic_ns()


node.create_subscription(String, "/pong", back, 10)
while ping.get_subscription_count() < 1 or node.count_publishers("/pong") < 1:
    rclpy.spin_once(node, timeout_sec=0.1)


def trip(number):
    begun = time.monotonic_ns()
    ping.publish(String(data=str(number)))
    while str(number) not in heard and time.monotonic_ns() - begun < 2_000_000_000:
        rclpy.spin_once(node, timeout_sec=0.1)
    return heard.pop(str(number), begun + 2_000_000_000) - begun


number = 0
print("ready", flush=True)
for line in sys.stdin:
    took = []
    for _ in range(int(line)):
        number += 1
        took.append(trip(number))
        time.sleep(max(0, 0.01 - took[-1] / 1e9))
    print(*took, flush=True)
