"""Cyclone DDS in rclpy_listener.py's place. Its interface has no multicast, so that it finds a peer by
the ports of its participants."""

import os
import time
from dataclasses import dataclass

os.environ["CYCLONEDDS_URI"] = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
    "</General><Discovery><ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>"
)

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


@dataclass
class Int32(IdlStruct, typename="std_msgs::msg::dds_::Int32_"):
    data: int32


participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
topic = Topic(participant, "rt/chatter", Int32)
chatter = DataReader(participant, topic, qos=Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(50)))
while True:
    for sample in chatter.take(50):
        if isinstance(sample, Int32):
            print(sample.data, flush=True)
    time.sleep(0.005)
