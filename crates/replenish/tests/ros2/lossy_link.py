"""A link that loses, doubles and reorders datagrams between two programs, by a seed.

lossy_link.py                                    ends with 0 if this machine can have such a link
lossy_link.py KIND SEED LOSS OURS... -- PEER...  runs both programs until this one is killed

Each program is in a network namespace of its own, whose only way out is one device; nothing in the
protocol is changed. LOSS is a percentage of all datagrams, discovery's too. Every line of a program
is passed on; a line about the link follows each line of PEER. Needs root.

KIND      device                                       how the programs find each other
lossy     TUN: a datagram of any length is one packet  multicast
wireless  TAP: datagrams in frames of 1500 bytes       multicast
ethernet  TAP; each frame comes once and in order,     multicast
          SEED and LOSS have no effect
named     as ethernet                                  OURS has ROS_STATIC_PEERS, no multicast
names     as ethernet                                  PEER has ROS_STATIC_PEERS, no multicast
late      as ethernet; the device of OURS comes up     multicast
          three seconds after both have started
amid      as ethernet; OURS gets another address       multicast
          after 400 datagrams
moving    as ethernet; OURS gets another address       multicast
          when PEER has said "answered"
alias     as ethernet; the device of OURS has          multicast
          two addresses
beside    as ethernet; PEER has another device         multicast
          before it, which leads nowhere
"""

import ctypes
import errno
import fcntl
import heapq
import os
import random
import select
import socket
import struct
import subprocess
import sys
import time

CLONE_NEWNET, PR_SET_PDEATHSIG, SIGKILL = 0x40000000, 1, 9
TUNSETIFF, IFF_TUN, IFF_TAP, IFF_NO_PI = 0x400454CA, 1, 2, 0x1000
SIOCGIFFLAGS, SIOCSIFFLAGS, SIOCSIFADDR, SIOCSIFNETMASK, SIOCSIFMTU = 0x8913, 0x8914, 0x8916, 0x891C, 0x8922
IFF_UP, IFF_MULTICAST = 1, 0x1000
# As on loopback, a datagram is a packet of TUN: its parts do not get lost one by one.
MTU = {IFF_TUN: 65535, IFF_TAP: 1500}
# Percent of the datagrams, and by how many seconds some of them come later.
DOUBLED, DELAYED, LATER = 5, 10, 0.02
ADDRESSES, OTHERS, BESIDE = ("10.9.0.1", "10.9.0.2"), "10.9.0.", "10.8.0.1"
# Seconds until a late device comes up, and datagrams until an address changes.
LATE, AMID = 3, 400
libc = ctypes.CDLL(None, use_errno=True)


class Namespace:
    """A network namespace with one device, which stays open when this process moves on."""

    def __init__(self, address, device=IFF_TUN, is_up=True, beside=False):
        """Moves this process into it; `beside`: with another device before that one."""
        if libc.unshare(CLONE_NEWNET) != 0:
            sys.exit("no network namespace: " + os.strerror(ctypes.get_errno()))
        # Stays in this namespace, too.
        self.control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        if beside:
            self.beside = self.make(b"beside", device)
            self.have(BESIDE, b"beside")
            self.set_up(b"beside", IFF_UP | IFF_MULTICAST)
        self.device = self.make(b"link", device)
        fcntl.ioctl(self.control, SIOCSIFMTU, struct.pack("16si20x", b"link", MTU[device]))
        self.set_up(b"lo", IFF_UP)
        if is_up:
            self.come_up(address)

    @staticmethod
    def make(name, device):
        try:
            made = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
            fcntl.ioctl(made, TUNSETIFF, struct.pack("16sH22x", name, device | IFF_NO_PI))
            return made
        except OSError as error:
            sys.exit(f"no /dev/net/tun: {error.strerror}")

    def come_up(self, address):
        self.have(address)
        self.set_up(b"link", IFF_UP | IFF_MULTICAST)

    def have(self, address, label=b"link"):
        """Gives the device this address instead of the one it has under this label."""

        def internet(number):
            return struct.pack("HH4s8x", socket.AF_INET, 0, socket.inet_aton(number))

        fcntl.ioctl(self.control, SIOCSIFADDR, struct.pack("16s16s8x", label, internet(address)))
        fcntl.ioctl(self.control, SIOCSIFNETMASK, struct.pack("16s16s8x", label, internet("255.255.255.0")))

    def set_up(self, device, flags):
        old = fcntl.ioctl(self.control, SIOCGIFFLAGS, struct.pack("16s24x", device))
        flags |= struct.unpack_from("H", old, 16)[0]
        fcntl.ioctl(self.control, SIOCSIFFLAGS, struct.pack("16sH22x", device, flags))


def start(words, **more):
    """A program that ends with this one."""
    return subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        env={**os.environ, **more},
        preexec_fn=lambda: libc.prctl(PR_SET_PDEATHSIG, SIGKILL),
    )


class Direction:
    """The datagrams from one device to the other."""

    def __init__(self, inlet, outlet, loss, seed):
        """`loss`: in percent; None: all that comes arrives, once and in order."""
        self.inlet, self.outlet, self.loss = inlet, outlet, loss
        self.chance = random.Random(seed)
        self.delayed = []
        self.seen = self.lost = self.doubled = self.overtaken = self.latest = 0

    def take(self):
        """Takes what the device has, a bounded number of packets."""
        for _ in range(64):
            try:
                packet = os.read(self.inlet, 65536)
            except BlockingIOError:
                return
            self.seen += 1
            if self.loss is None:
                self.give(self.seen, packet)
                continue
            if self.chance.uniform(0, 100) < self.loss:
                self.lost += 1
                continue
            double = self.chance.uniform(0, 100) < DOUBLED
            self.doubled += double
            for _ in range(1 + double):
                if self.chance.uniform(0, 100) < DELAYED:
                    due = time.monotonic() + self.chance.uniform(0, LATER)
                    heapq.heappush(self.delayed, (due, self.seen, packet))
                else:
                    self.give(self.seen, packet)

    def give(self, number, packet):
        self.overtaken += number < self.latest
        self.latest = max(self.latest, number)
        try:
            os.write(self.outlet, packet)
        except OSError as error:
            if error.errno != errno.EIO:  # that of a device that is down
                raise
            self.lost += 1

    def give_delayed(self):
        while self.delayed and self.delayed[0][0] <= time.monotonic():
            self.give(*heapq.heappop(self.delayed)[1:])

    def __str__(self):
        return f"{self.seen} datagrams, {self.lost} lost, {self.doubled} doubled, {self.overtaken} overtaken"


def discovery(kind, naming, other):
    """The variables by which a program finds the one with the address `other`."""
    if kind in ("named", "names"):
        peers = other if kind == naming else ""
        return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": peers}
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


def main(kind, seed, loss, ours, peer):
    device = IFF_TUN if kind == "lossy" else IFF_TAP
    loss = loss if kind in ("lossy", "wireless") else None
    here = Namespace(ADDRESSES[0], device, kind != "late")
    if kind == "alias":
        here.have(OTHERS + "3", b"link:1")
    ours = start(ours, **discovery(kind, "named", ADDRESSES[1]))
    there = Namespace(ADDRESSES[1], device, beside=kind == "beside")
    peer = start(peer, REPLENISH_PEER_ADDRESS=ADDRESSES[1], **discovery(kind, "names", ADDRESSES[0]))
    out = Direction(here.device, there.device, loss, 2 * seed)
    back = Direction(there.device, here.device, loss, 2 * seed + 1)
    begin, moves = time.monotonic(), 0
    lines = {program.stdout.fileno(): b"" for program in (ours, peer)}
    while True:
        if kind == "late" and time.monotonic() > begin + LATE:
            here.come_up(ADDRESSES[0])
            kind = "ethernet"
        if kind == "amid" and out.seen + back.seen > AMID:
            here.have(OTHERS + "3")
            kind = "ethernet"
        wait = 0.001 if out.delayed or back.delayed else 1
        ready = select.select([here.device, there.device, *lines], [], [], wait)[0]
        for way in (out, back):
            if way.inlet in ready:
                way.take()
            way.give_delayed()
        for program in lines:
            if program not in ready:
                continue
            text = os.read(program, 4096)
            if not text:
                sys.exit("a program has ended")
            whole, newline, lines[program] = (lines[program] + text).rpartition(b"\n")
            if newline and program == peer.stdout.fileno():
                if kind == "moving" and b"answered" in whole:
                    moves += 1
                    here.have(OTHERS + str(2 + moves))
                whole += f"\nto the peer {out}; from it {back}".encode()
            os.write(1, whole + newline)


if len(sys.argv) == 1:
    Namespace(ADDRESSES[0])
else:
    split = sys.argv.index("--")
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), sys.argv[4:split], sys.argv[split + 1 :])
