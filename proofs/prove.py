#!/usr/bin/env python3
"""Proves the theorem of docs/servers.md for any budget, period, times and amounts, by induction over
the calls: what holds before a call holds after it. `model.py` is the code, as `differential.py` shows.

    prove.py [N] [obligation…]      N: the most replenishments pending (default: 1, 2 and 3)
"""

import sys
import time

import z3

import model
import paths
from model import HIGH, LOW, NEVER

Int, And, Or, Not, If, Sum = z3.Int, z3.And, z3.Or, z3.Not, z3.If, z3.Sum


def at(chunks, x):
    """The time of the unit of budget in place x, the first being 0."""
    total, result = Sum([a for _, a in chunks]), chunks[-1][0]
    for when, amount in reversed(chunks):
        total = total - amount
        result = If(x < total + amount, when, result)
    return result


def invariant(server):
    """Of the corrected server."""
    chunks = server.chunks()
    times = [time for time, _ in chunks]
    return [
        Sum([amount for _, amount in chunks]) == server.budget,
        *[amount > 0 for _, amount in chunks],
        *[a < b for a, b in zip(times, times[1:])],
        times[-1] <= times[0] + server.period,
        len(server.queue) <= server.limit,
    ]


def parameters():
    budget, period, least = Int("B"), Int("T"), Int("min_chunk")
    return budget, period, least, [0 < budget, budget <= period, least >= 0]


def any_server(queued, limit, head=None):
    """A server in any state with so many chunks in its queue."""
    budget, period, least, assumed = parameters()
    server = model.Corrected(budget, period, limit, least, Int("clock"))
    chunks = [(Int(f"time{i}"), Int(f"amount{i}")) for i in range(queued + 1)]
    server.head, server.queue = chunks[0], chunks[1:]
    assumed += [*invariant(server), server.clock >= 0, chunks[0][0] >= 0]
    return server, assumed


def copy(server):
    new = model.Corrected(server.budget, server.period, server.limit, server.min_chunk, server.clock)
    new.head, new.queue = server.head, list(server.queue)
    return new


def states(limit):
    return [any_server(queued, limit) for queued in range(limit + 1)]


def activation(limit):
    """An activation at `now` gives every unit that is due the time `now`, and changes no other."""
    for server, assumed in states(limit):
        now, x = Int("now"), Int("x")
        here = [now >= server.clock, 0 <= x, x < server.budget]

        def code():
            after = copy(server)
            after.activate(now)
            old, new = at(server.chunks(), x), at(after.chunks(), x)
            return [*invariant(after), new == If(old <= now, now, old), after.clock == now]

        yield assumed + here, code


def consumption(limit):
    """The theorem. Of a charge of `used`, less than B, up to `now`: every unit that was consumed
    comes back a period after its activation e or later, with e no earlier than its time, and no
    earlier than a period before the consumption began; every other unit keeps its place in the
    queue, and comes no earlier than it would have. So two uses of a unit have activations at
    least T apart, and units are used in turn."""
    for server, assumed in states(limit):
        now, used, x = Int("now"), Int("used"), Int("x")
        budget, period = server.budget, server.period
        here = [now >= server.clock, 0 <= used, used < budget, 0 <= x, x < budget]

        def code():
            after = copy(server)
            after.charge(used, now)
            since = If(now >= used + period, now - used - period, 0)
            place = If(x < budget - used, x + used, x - (budget - used))
            old, new = at(server.chunks(), place), at(after.chunks(), x)
            earliest = If(old <= since, since, old) + If(x < budget - used, 0, period)
            exact = [new == earliest] if not after.merged else [new >= earliest]
            return [*invariant(after), *exact, after.clock == now]

        yield assumed + here, code


def merging(limit):
    """What a limit of the server delays: nothing is later than a period after the last
    activation, and without a full queue only what is smaller than the smallest chunk waits."""
    for server, assumed in states(limit):
        now, used = Int("now"), Int("used")
        here = [now >= server.clock, 0 <= used, used < server.budget]

        def code():
            after = copy(server)
            after.charge(used, now)
            last = larger(now, server.chunks()[-1][0])
            head = after.head[1]
            small = Or(head >= server.min_chunk, len(after.queue) == 0)
            return [after.chunks()[-1][0] <= last + server.period, small]

        yield assumed + here, code


def large_charges(limit):
    """A charge of B and more, up to 2 B: each unit has its round, and the rest goes as before."""
    for server, assumed in states(limit):
        now, used = Int("now"), Int("used")
        here = [now >= server.clock, server.budget <= used, used < 2 * server.budget]
        here += [used <= now]

        def code():
            after, other = copy(server), copy(server)
            after.charge(used, now)
            other.count_from(paths_minus(now - used, server.period))
            other.head = (other.head[0] + server.period, other.head[1])
            other.queue = [(time + server.period, amount) for time, amount in other.queue]
            # The rest of the charge, which `consumption` is about; nothing is due that long now.
            other.clock = other.head[0]
            other.charge(used - server.budget, other.head[0])
            same = [a == b for p, q in zip(after.chunks(), other.chunks()) for a, b in zip(p, q)]
            return [*invariant(after), len(after.chunks()) == len(other.chunks()), *same]

        yield assumed + here, code


def answers(limit):
    """`update`, `available` and `next_replenishment` agree with each other and with the chunks."""
    for server, assumed in states(limit):
        now, x = Int("now"), Int("x")
        here = [now >= server.clock, 0 <= x, x < server.budget]

        def code():
            after = copy(server)
            available = server.available(now)
            level = after.update(now)
            later = after.next_replenishment()
            due = at(server.chunks(), x) <= now
            facts = [due == (x < available), (level == HIGH) == (available > 0)]
            facts += [(level == LOW) == (later is not None)]
            return facts + ([later > now] if later is not None else [])

        yield assumed + here, code


def larger(a, b):
    return If(a >= b, a, b)


def paths_minus(a, b):
    return model.minus(a, b)


class Anything:
    """Any server at all that answers as `answers` says: what it has changes with every call, to
    whatever it likes."""

    def __init__(self):
        self.budget, self.period, self.calls = Int("B"), Int("T"), 0

    def change(self, *_):
        self.calls += 1

    charge = activate = block = change

    def available(self, _now):
        return Int(f"available{self.calls}")

    def update(self, now):
        return HIGH if paths.holds(self.available(now) > 0) else LOW

    def next_replenishment(self):
        return Int(f"next{self.calls}")

    def promises(self, now):
        return [Int(f"available{i}") >= 0 for i in range(9)] + [
            Or(Int(f"available{i}") > 0, Int(f"next{i}") > now) for i in range(9)
        ]


def clone(first):
    r = model.Reservation.__new__(model.Reservation)
    r.__dict__.update(first.__dict__)
    r.server = copy(first.server) if isinstance(first.server, model.Corrected) else Anything()
    return r


def reservations(servers, levels=(HIGH, LOW)):
    """A reservation in any state that its own invariant allows."""
    for server, assumed in servers:
        for level in levels:
            for runnable in (True, False):
                slack, rearm, backoff = Int("slack"), Int("min_rearm"), Int("max_backoff")
                r = model.Reservation(server, slack, rearm, backoff, Int("read_at"), Int("mark"))
                r.runnable, r.level = runnable, level
                r.advance, r.backoff, r.check_at = Int("advance"), Int("backoff"), Int("check_at")
                facts = [slack >= 0, rearm >= 0, backoff >= 0, r.cpu_mark >= 0, r.read_at >= 0]
                if isinstance(server, model.Corrected):
                    facts += [server.clock == r.read_at]
                yield r, assumed + facts + sound(r)


def longest(r):
    """The longest distance between two checks of a thread without progress, as a formula."""
    return larger(r.min_rearm, r.max_backoff)


def sound(r):
    """The invariant of a reservation: what is charged in advance is no more than the slack."""
    return [0 <= r.advance, r.advance <= r.slack, 0 <= r.backoff, r.backoff <= longest(r)]


def is_checked(r):
    """(d): somebody looks after it in time, whatever it consumes, as of the last reading."""
    if r.level == LOW:
        return [r.check_at <= larger(r.read_at, r.server.next_replenishment())]
    if not r.runnable:
        return []
    left = r.server.available(r.read_at) + r.advance
    return [r.check_at <= r.read_at + larger(larger(left, r.min_rearm), longest(r))]


def calls():
    """Each call with what is reported to it."""
    now, cpu, woken, amount = Int("now"), Int("cpu"), Int("woken"), Int("amount")
    for intervals in (None, [(Int("ran"), Int("out_at"), Int("in_at"))]):
        yield "judge", lambda r: r.judge(now, cpu, intervals)
        yield "observe", lambda r: r.observe(now, cpu, intervals)
        yield "block", lambda r: r.block(now, cpu, intervals)
    yield "activate", lambda r: r.activate(woken, now, cpu)
    yield "applied", lambda r: r.applied(HIGH, now, cpu)
    yield "applied", lambda r: r.applied(LOW, now, cpu)
    yield "owe", lambda r: r.owe(amount, now)


def bookkeeping(_limit):
    """Whatever the server does, after every call: CPU time is conserved, (c); the server was charged
    what was consumed at the high level, what is owed, and what is paid in advance; that is at
    most the slack; and (d) holds, unless the owner was given a verdict, which it confirms. Who waits
    at the high level has budget, or a check at once."""
    server = Anything()
    assumed = [0 < server.budget, server.budget <= server.period]
    for first, facts in reservations([(server, assumed)]):
        now, cpu = Int("now"), Int("cpu")
        here = [now >= first.read_at, cpu >= first.cpu_mark, now < NEVER, Int("ran") >= 0]
        here += [Int("amount") >= 0, *server.promises(now)]
        for name, call in calls():

            def code():
                r = clone(first)
                verdict = call(r)
                still = name == "owe" or first.sleeps_funded() and name in ("judge", "observe")
                spent = 0 if still else cpu - first.cpu_mark
                facts = sound(r) + [r.cpu_high + r.cpu_low == spent]
                facts += [(r.cpu_low if first.level == HIGH else r.cpu_high) == 0]
                facts += [r.charged == r.cpu_high + r.owed + r.advance - first.advance]
                unchanged = r.level == first.level and name == "applied"
                if verdict is None and name not in ("block", "owe") and not unchanged and not still:
                    facts += is_checked(r)
                if name == "block" and r.level == HIGH:
                    facts += [Or(r.server.available(now) > 0, r.check_at <= now)]
                return facts

            yield assumed + facts + here, code


def waiting(limit):
    """(d) for a thread at the low level: the check that is set is not after the next replenishment
    when it begins to wait, or owes something, or another reading was confirmed."""
    for first, facts in reservations(states(limit), levels=(LOW,)):
        now, cpu = Int("now"), Int("cpu")
        ran, out, back = Int("ran"), Int("out_at"), Int("in_at")
        here = [now >= first.read_at, cpu >= first.cpu_mark, ran >= 0, now < NEVER]
        here += [first.read_at <= out, out <= back, back <= now]
        here += [first.check_at <= larger(first.read_at, first.server.head[0])]
        amount = Int("amount")
        here += [0 <= amount, amount < first.server.budget]
        for name, call in calls():
            if name not in ("block", "owe"):
                continue

            def code():
                r = clone(first)
                call(r)
                return [*invariant(r.server), r.check_at <= larger(now, r.server.head[0])]

            yield facts + here, code


def unknown_blocking(limit):
    """After a reading that does not know: nothing is due since before the consumption can have
    begun. A unit in place x of what was consumed, charged at once, comes back a period after
    now - used + x, when it can have been consumed at the latest, less the x that go before it."""
    for first, assumed in reservations(states(limit), levels=(HIGH,)):
        if not first.runnable:
            continue
        now, cpu, x = Int("now"), Int("cpu"), Int("x")
        used, budget = cpu - first.cpu_mark, first.server.budget
        here = [now >= first.read_at, used >= 0, used <= now - first.read_at, now < NEVER]
        here += [first.advance == 0, used < budget, 0 <= x, x < used]

        def code():
            r = clone(first)
            r.observe(now, cpu, None)
            place = budget - used + x
            back = at(r.server.chunks(), place)
            return [back >= now - used + first.server.period, r.server.head[0] >= now - used]

        yield assumed + here, code


def recorded_blocking(limit):
    """After a reading in which the thread blocked up to `back`, at either level: no unit of its
    budget counts as activated before, nor is any due from before. So a window that begins while the
    thread waits has each unit once. (`consumption` is about what it used before it blocked.)"""
    for first, assumed in reservations(states(limit)):
        if not first.runnable:
            continue
        now, cpu, out, back = Int("now"), Int("cpu"), Int("out_at"), Int("in_at")
        used = cpu - first.cpu_mark
        here = [first.read_at <= out, out <= back, back <= now, now < NEVER]
        here += [0 <= used, used <= now - back, used < first.server.budget, first.advance == 0]

        def code():
            r = clone(first)
            r.account(now, cpu, [(0, out, back)])
            return [*invariant(r.server), r.server.head[0] >= back]

        yield assumed + here, code


OBLIGATIONS = [
    activation,
    consumption,
    merging,
    large_charges,
    answers,
    bookkeeping,
    waiting,
    unknown_blocking,
    recorded_blocking,
]


def prove(obligation, limit):
    """The number of paths; raises what refutes it."""
    count = 0
    for assumed, code in obligation(limit):
        for solver, facts in paths.explore(assumed, code):
            count += 1
            facts = [f if z3.is_expr(f) else z3.BoolVal(f) for f in facts]
            solver.push()
            solver.add(Not(And(facts)))
            answer = solver.check()
            if answer != z3.unsat:
                raise AssertionError(f"{obligation.__name__}, N = {limit}: {answer}")
            solver.pop()
    return count


def main():
    given = sys.argv[1:]
    limits = [int(g) for g in given if g.isdigit()] or [1, 2, 3]
    chosen = [o for o in OBLIGATIONS if o.__name__ in given] or OBLIGATIONS
    for obligation in chosen:
        for limit in limits if obligation is not bookkeeping else limits[:1]:
            start = time.time()
            count = prove(obligation, limit)
            took = time.time() - start
            print(f"proved {obligation.__name__:18} N = {limit}: {count:6} paths, {took:6.1f} s", flush=True)


if __name__ == "__main__":
    main()
