"""Cyclone DDS in rclpy_echo.py's place: strings of /ping and /latched come back on /pong."""

import os
import sys
import time
from dataclasses import dataclass

IPV4 = (
    '<General><Interfaces><NetworkInterface address="127.0.0.1" multicast="true"/></Interfaces></General>'
)
IPV6 = (
    '<General><Interfaces><NetworkInterface address="::1"/></Interfaces>'
    "<Transport>udp6</Transport><AllowMulticast>false</AllowMulticast></General>"
    '<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="[::1]"/></Peers></Discovery>'
)
chosen = IPV6 if sys.argv[1:] == ["ipv6"] else IPV4
os.environ["CYCLONEDDS_URI"] = f"<CycloneDDS><Domain>{chosen}</Domain></CycloneDDS>"

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
reliable = Policy.Reliability.Reliable(duration(seconds=10))
qos = Qos(reliable, Policy.History.KeepLast(200))
late = Qos(reliable, Policy.History.KeepLast(10), Policy.Durability.TransientLocal)
pong = DataWriter(participant, Topic(participant, "rt/pong", String), qos=qos)
ping = DataReader(participant, Topic(participant, "rt/ping", String), qos=qos)
latched = DataReader(participant, Topic(participant, "rt/latched", String), qos=late)
print("ready", flush=True)
while True:
    if pong.get_matched_subscriptions():
        for reader in (latched, ping):
            for sample in reader.take(50):
                if isinstance(sample, String):
                    pong.write(sample)
    time.sleep(0.001)
