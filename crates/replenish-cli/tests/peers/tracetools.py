"""Reads a CTF trace of `replenish trace --ctf` with ROS 2's tracetools_analysis.

Prints each callback: its symbol, how often it ran, and the nanoseconds of all its executions.
"""

import contextlib
import io
import sys

from tracetools_analysis.processor.ros2 import Ros2Handler
from tracetools_analysis.utils.ros2 import Ros2DataModelUtil
from tracetools_read.trace import get_trace_events

with contextlib.redirect_stdout(io.StringIO()):  # its progress
    handler = Ros2Handler.process(get_trace_events(sys.argv[1]))
util = Ros2DataModelUtil(handler.data)
for callback, symbol in util.get_callback_symbols().items():
    durations = util.get_callback_durations(callback)["duration"]
    print(symbol, len(durations), sum(int(duration.value) for duration in durations))
