"""rclpy as a reader of our log, and as the one who sets its levels."""

import rclpy
from rcl_interfaces.msg import Log, LoggerLevel
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.qos import DurabilityPolicy, QoSProfile


def logs(node, name, say, until):
    durable = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    seen = []
    node.create_subscription(Log, "/rosout", seen.append, durable)
    ours = lambda: [line for line in seen if line.name == "peer.ours"]
    until(node, lambda: len(ours()) >= 3)
    for line in ours()[:3]:
        say(line.level, line.msg, line.file.rsplit("/")[-1], line.line > 0, line.stamp.sec > 0)
    all_infos = lambda: node.get_publishers_info_by_topic("/rosout")
    named = lambda: [i for i in all_infos() if i.node_name == "ours"]
    until(node, named)
    qos = named()[0].qos_profile
    say(qos.reliability.name, qos.durability.name, qos.lifespan.nanoseconds)
    set_levels = node.create_client(SetLoggerLevels, f"{name}/set_logger_levels")
    get_levels = node.create_client(GetLoggerLevels, f"{name}/get_logger_levels")
    until(node, lambda: set_levels.service_is_ready() and get_levels.service_is_ready())
    level = LoggerLevel(name="peer.ours", level=40)
    future = set_levels.call_async(SetLoggerLevels.Request(levels=[level]))
    until(node, future.done)
    say([result.successful for result in future.result().results])
    future = get_levels.call_async(GetLoggerLevels.Request(names=["peer.ours", "other"]))
    until(node, future.done)
    say([level.level for level in future.result().levels])
    while True:
        rclpy.spin_once(node, timeout_sec=0.5)
