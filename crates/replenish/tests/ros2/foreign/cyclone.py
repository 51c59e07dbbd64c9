"""Eclipse Cyclone DDS 11 in peer.py's place.

cyclone.py topics N   as peer.py does
cyclone.py images N   as peer.py does
cyclone.py client N   asks /peer/add N times
cyclone.py statistics N  says what N kinds of figures on /statistics are
cyclone.py serve      serves /peer/add; runs until it is killed
"""

import os
import sys
import time
from dataclasses import dataclass

sys.dont_write_bytecode = True  # of the module that stands there
sys.path.append(os.path.join(os.path.dirname(__file__), "../../../../replenish-agent/tests/peers"))

from cyclone_dds import BEST_EFFORT, RELIABLE, Program, say, valid
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint8, uint32


@dataclass
class Int32(IdlStruct, typename="std_msgs::msg::dds_::Int32_"):
    data: int32


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Point(IdlStruct, typename="statistics_msgs::msg::dds_::StatisticDataPoint_"):
    data_type: uint8
    data: float64


@dataclass
class Metrics(IdlStruct, typename="statistics_msgs::msg::dds_::MetricsMessage_"):
    measurement_source_name: str
    metrics_source: str
    unit: str
    window_start: Time
    window_stop: Time
    statistics: sequence[Point]


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


program = Program(int(os.environ["ROS_DOMAIN_ID"]))
reader, writer = program.reader, program.writer


def topics(count):
    kinds = {"reliable": RELIABLE, "best_effort": BEST_EFFORT}
    for kind, reliability in kinds.items():
        out = writer(f"rt/peer/{kind}_to_ours", Int32, reliability)
        back = reader(f"rt/peer/{kind}_from_ours", Int32, reliability)
        # Both sides know each other once something has come back; then until nothing more comes.
        while not valid(back):
            out.write(Int32(data=0))
            time.sleep(0.1)
        quiet = time.monotonic()
        while time.monotonic() - quiet < 1:
            quiet = time.monotonic() if valid(back) else quiet
            time.sleep(0.01)
        seen = []

        def take():
            # Where the network loses some, a late one of the first may come until the numbers begin.
            seen.extend(sample.data for sample in valid(back) if sample.data or seen)

        for number in range(1, count + 1):
            out.write(Int32(data=number))
            time.sleep(0.002)
            take()
        end = time.monotonic() + 50
        while len(seen) < count and time.monotonic() < end:
            take()
            time.sleep(0.01)
        time.sleep(0.5)
        take()
        say(kind, len(seen), seen == list(range(1, count + 1)))


def images(count):
    out = writer("rt/peer/image_to_ours", Image)
    back = reader("rt/peer/image_from_ours", Image)
    header = Header(stamp=Time(sec=0, nanosec=0), frame_id="")
    first, heard = [], []

    def image(number):
        data = bytes((number * 31 + place) % 251 for place in range(10_000)) * 100
        return Image(header, number, 0, "mono8", 0, 0, data)

    def take(seconds, enough=lambda: False):
        end = time.monotonic() + seconds
        while time.monotonic() < end and not enough():
            for m in valid(back):
                (heard if m.height or heard else first).append(m)
            time.sleep(0.01)

    greeting = image(0)
    while not first:
        out.write(greeting)
        take(1)
    right = 0
    take(1)
    for number in range(1, count + 1):
        sent = image(number)
        out.write(sent)
        take(50, lambda: len(heard) >= number)
        right += len(heard) == number and heard[-1].height == number and bytes(heard[-1].data) == sent.data
    take(0.5)
    say("images", right, "of", len(heard))


def client(count):
    say("answered", program.ask("peer/add", count))


def serve():
    program.serve("peer/add")


def statistics(count):
    figures, seen = reader("rt/statistics", Metrics), {}
    while len(seen) < count:
        for m in valid(figures):
            seen[m.measurement_source_name, m.metrics_source] = m
        time.sleep(0.01)
    for name, m in sorted(seen.items()):
        mean, low, high, deviation, calls = (point.data for point in m.statistics)
        least = 5 if name == ("late/timer:0", "response") else 0
        right = least <= low <= mean <= high and deviation >= 0 and calls >= 1
        right &= m.window_start.sec <= m.window_stop.sec
        say(*name, m.unit, [point.data_type for point in m.statistics], right)


mode, *rest = sys.argv[1:]
modes = {"topics": topics, "images": images, "client": client, "serve": serve, "statistics": statistics}
modes[mode](*map(int, rest))
