"""Reads a trace of `replenish trace` with Perfetto's own protobuf module.

No field is unknown to it; every event stands on a described track; slices nest; every flow has both
ends; a budget is 0 exactly where an exhausted event stands. Prints the number of events.
"""

import collections
import sys

from google.protobuf.unknown_fields import UnknownFieldSet
from perfetto.protos.perfetto.trace import perfetto_trace_pb2 as pb


def unknown(message):
    """How many fields of a message and of those in it the module does not know."""
    count = len(UnknownFieldSet(message))
    for field, value in message.ListFields():
        if field.message_type is not None:
            parts = [value] if hasattr(value, "ListFields") else value
            count += sum(unknown(part) for part in parts)
    return count


trace = pb.Trace()
with open(sys.argv[1], "rb") as file:
    trace.ParseFromString(file.read())
assert unknown(trace) == 0
first = trace.packet[0].clock_snapshot.clocks
assert sorted(clock.clock_id for clock in first) == [1, 3, 6]
tracks, kinds, clocks = {}, {}, {}
depth = collections.Counter()
begun, ended, exhausted, empty = [], [], set(), set()
events = 0
for packet in trace.packet:
    sequence = packet.trusted_packet_sequence_id
    if packet.HasField("track_descriptor"):
        tracks[sequence] = packet.trace_packet_defaults.track_event_defaults.track_uuid
        clocks[sequence] = packet.trace_packet_defaults.timestamp_clock_id
        assert tracks[sequence] == packet.track_descriptor.uuid
        kinds[sequence] = packet.track_descriptor
    if not packet.HasField("track_event"):
        continue
    events += 1
    event, track = packet.track_event, kinds[sequence]
    assert clocks[sequence] == 3
    if event.type == event.TYPE_SLICE_BEGIN:
        depth[sequence] += 1
        assert event.name and track.HasField("thread")
    elif event.type == event.TYPE_SLICE_END:
        depth[sequence] -= 1
        assert depth[sequence] >= 0
    elif event.type == event.TYPE_COUNTER:
        assert track.counter.unit == track.counter.UNIT_TIME_NS
        if event.counter_value == 0:
            empty.add(packet.timestamp)
    elif event.type == event.TYPE_STATE:
        assert track.HasField("state") and event.name in ("high", "background")
    else:
        assert event.type == event.TYPE_INSTANT and event.name
        if event.name == "exhausted":
            exhausted.add(packet.timestamp)
    begun.extend(event.flow_ids)
    ended.extend(event.terminating_flow_ids)
# A chain's flow goes through each of its stages; it ends once.
assert sorted(set(begun)) == sorted(ended) and begun
assert exhausted and exhausted <= empty
assert len({d.uuid for d in kinds.values()}) == len(kinds)
print(events)
