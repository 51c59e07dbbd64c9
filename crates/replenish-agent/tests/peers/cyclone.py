"""A ROS 2 program on Cyclone DDS, as rmw_cyclonedds would write to the network, on loopback:
found as ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST makes it, by well-known ports, without multicast.

usage: cyclone.py echo|replier|requester DOMAIN [reliable|best_effort] [COUNT]

The environment variable LEASE sets its lease, in seconds.

Prints "ready" when its entities exist. echo and replier run until they are killed; requester prints
"done" after COUNT replies.
"""

import os
import sys
import time
from dataclasses import dataclass

os.environ["CYCLONEDDS_URI"] = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/>'
    "</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex><Peers>"
    '<Peer address="127.0.0.1"/></Peers>'
    f"<LeaseDuration>{os.environ.get('LEASE', '10')}s</LeaseDuration>"
    "</Discovery></Domain></CycloneDDS>"
)

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int64, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

SERVICE = "example_interfaces::srv::dds_::AddTwoInts"


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


# Requests and replies begin with the header of rmw_cyclonedds: who asks, and which request it is.
@dataclass
class Request(IdlStruct, typename=SERVICE + "_Request_"):
    guid: uint64
    seq: int64
    a: int64
    b: int64


@dataclass
class Reply(IdlStruct, typename=SERVICE + "_Response_"):
    guid: uint64
    seq: int64
    sum: int64


def qos(reliable):
    kind = Policy.Reliability
    reliability = kind.Reliable(duration(seconds=1)) if reliable else kind.BestEffort
    return Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(100))


def samples(reader):
    while True:
        for sample in reader.take(16):
            if sample.sample_info.valid_data:  # otherwise a writer is gone
                yield sample
        time.sleep(0.001)


def main():
    mode, domain = sys.argv[1], int(sys.argv[2])
    reliable = "best_effort" not in sys.argv
    participant = DomainParticipant(domain)

    def reader(name, kind):
        return DataReader(participant, Topic(participant, name, kind), qos=qos(reliable))

    def writer(name, kind):
        return DataWriter(participant, Topic(participant, name, kind), qos=qos(reliable))

    if mode == "echo":
        heard, said = reader("rt/chatter", String), writer("rt/echo", String)
        print("ready", flush=True)
        for sample in samples(heard):
            said.write(String(data="echo of " + sample.data))
    elif mode == "replier":
        asked, answers = reader("rq/addRequest", Request), writer("rr/addReply", Reply)
        print("ready", flush=True)
        for ask in samples(asked):
            answers.write(Reply(guid=ask.guid, seq=ask.seq, sum=ask.a + ask.b))
    elif mode == "requester":
        answers, asks = reader("rr/addReply", Reply), writer("rq/addRequest", Request)
        print("ready", flush=True)
        while not (asks.get_matched_subscriptions() and answers.get_matched_publications()):
            time.sleep(0.01)
        replies = samples(answers)
        for seq in range(1, int(sys.argv[-1]) + 1):
            asks.write(Request(guid=0x0102030405060708, seq=seq, a=seq, b=1000))
            reply = next(replies)
            assert (reply.guid, reply.seq) == (0x0102030405060708, seq), reply
            assert reply.sum == seq + 1000, reply
        print("done", flush=True)
    else:
        sys.exit(__doc__)


main()
