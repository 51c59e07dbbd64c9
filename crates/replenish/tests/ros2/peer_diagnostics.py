"""rclpy as a reader of /diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray


def diagnostics(node, say, until):
    arrays = []
    node.create_subscription(DiagnosticArray, "/diagnostics", arrays.append, 10)
    level = lambda status: int.from_bytes(status.level, "little")
    worker = lambda status: status.name.rsplit(": ")[-1]
    late = lambda: [s for a in arrays for s in a.status if worker(s) == "late" and level(s)]
    until(node, late)
    say(worker(late()[0]), level(late()[0]), late()[0].message.split(" ", 1)[1])
    say(*sorted(worker(s) for s in arrays[-1].status))
    say(arrays[-1].header.stamp.sec > 0, len(late()[0].values))
    info = node.get_publishers_info_by_topic("/diagnostics")[0]
    say(info.node_name, "RIHS01" in str(info.topic_type_hash))
