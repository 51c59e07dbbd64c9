"""Eclipse Cyclone DDS 11 as rmw_cyclonedds would write to the network: what the programs in Python
share. It is found as ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST makes it, by well-known ports, without
multicast, on loopback or at REPLENISH_PEER_ADDRESS.

The environment variable LEASE sets its lease, in seconds.
"""

import os
import time
from dataclasses import dataclass

ADDRESS = os.environ.get("REPLENISH_PEER_ADDRESS", "127.0.0.1")
os.environ["CYCLONEDDS_URI"] = (
    f'<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="{ADDRESS}"/>'
    "</Interfaces></General><Discovery><ParticipantIndex>auto</ParticipantIndex><Peers>"
    f'<Peer address="{ADDRESS}"/></Peers>'
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
CLIENT = 0x0102030405060708
RELIABLE = Policy.Reliability.Reliable(duration(seconds=10))
BEST_EFFORT = Policy.Reliability.BestEffort


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


def say(*words):
    print(*words, flush=True)


def valid(reader):
    # A sample without valid data says that a writer is gone.
    return [sample for sample in reader.take(500) if sample.sample_info.valid_data]


class Program:
    """A participant, and the service that adds two numbers."""

    def __init__(self, domain):
        self.participant = DomainParticipant(domain)

    def topic(self, name, kind, reliability):
        qos = Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(500))
        return {"topic": Topic(self.participant, name, kind), "qos": qos}

    def reader(self, name, kind, reliability=RELIABLE):
        return DataReader(self.participant, **self.topic(name, kind, reliability))

    def writer(self, name, kind, reliability=RELIABLE):
        return DataWriter(self.participant, **self.topic(name, kind, reliability))

    def serve(self, name):
        """Says "ready" and runs until it is killed."""
        asked, answers = self.reader(f"rq/{name}Request", Request), self.writer(f"rr/{name}Reply", Reply)
        say("ready")
        while True:
            for ask in valid(asked):
                answers.write(Reply(guid=ask.guid, seq=ask.seq, sum=ask.a + ask.b))
            time.sleep(0.001)

    def ask(self, name, count):
        """Asks a service COUNT times, and returns the number of right answers."""
        answers, asks = self.reader(f"rr/{name}Reply", Reply), self.writer(f"rq/{name}Request", Request)
        while not (asks.get_matched_subscriptions() and answers.get_matched_publications()):
            time.sleep(0.01)
        # The server may see the reader of replies a little later than the writer of requests.
        time.sleep(0.5)
        right = 0
        for seq in range(1, count + 1):
            asks.write(Request(guid=CLIENT, seq=seq, a=seq, b=1000))
            end = time.monotonic() + 50
            while not (replies := valid(answers)) and time.monotonic() < end:
                time.sleep(0.001)
            got = [(reply.guid, reply.seq, reply.sum) for reply in replies]
            right += got == [(CLIENT, seq, seq + 1000)]
        return right
