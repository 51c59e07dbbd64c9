"""A ROS 2 program on Cyclone DDS.

usage: cyclone.py echo|replier|requester DOMAIN [reliable|best_effort] [COUNT]

echo and replier print "ready" when their entities exist, and run until they are killed; requester
prints "ready" at its start, and "done" after COUNT right replies.
"""

import sys
import time
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct

sys.dont_write_bytecode = True  # of the module that stands beside this one

from cyclone_dds import BEST_EFFORT, RELIABLE, Program, say, valid


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


mode, program = sys.argv[1], Program(int(sys.argv[2]))
if mode == "echo":
    reliability = BEST_EFFORT if "best_effort" in sys.argv else RELIABLE
    heard = program.reader("rt/chatter", String, reliability)
    said = program.writer("rt/echo", String, reliability)
    say("ready")
    while True:
        for sample in valid(heard):
            said.write(String(data="echo of " + sample.data))
        time.sleep(0.001)
elif mode == "replier":
    program.serve("add")
elif mode == "requester":
    count = int(sys.argv[-1])
    say("ready")
    if program.ask("add", count) == count:
        say("done")
else:
    sys.exit(__doc__)
