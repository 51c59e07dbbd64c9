"""The corrected server and the reservation, statement by statement as in crates/sporadic/src, over
numbers or over symbols of z3. `differential.py` compares it with the code, `prove.py` proves
the theorem about it."""

import paths

NEVER = 1 << 62
HIGH, LOW = "High", "Low"


def smaller(a, b):
    return a if paths.holds(a <= b) else b


def larger(a, b):
    return a if paths.holds(a >= b) else b


def minus(a, b):
    """saturating_sub"""
    return a - b if paths.holds(a >= b) else 0 * a


class Corrected:
    """corrected.rs; times do not saturate at the end of time here."""

    def __init__(self, budget, period, limit, min_chunk, now):
        self.budget, self.period, self.limit = budget, period, limit
        self.min_chunk, self.clock = min_chunk, now
        self.head = (now, budget)
        self.queue = []
        self.merged = False  # a ghost: whether a limit of the server has acted

    def chunks(self):
        return [self.head] + self.queue

    def see(self, now):
        self.clock = larger(self.clock, now)
        return self.clock

    def charge(self, used, now):
        now = self.see(now)
        self.count_from(minus(minus(now, used), self.period))
        rest = used
        if paths.holds(used >= self.budget):
            rounds, rest = paths.divide(used, self.budget)
            delay = rounds * self.period
            self.head = (self.head[0] + delay, self.head[1])
            self.queue = [(time + delay, amount) for time, amount in self.queue]
        while paths.holds(rest > 0):
            time, amount = self.head
            taken = smaller(rest, amount)
            rest = rest - taken
            back = (time + self.period, taken)
            if paths.holds(taken < amount):
                self.head = (time, amount - taken)
            elif self.queue:
                self.head = self.queue.pop(0)
            else:
                self.head = back
                continue
            self.push(back)
        while self.queue and paths.holds(self.head[1] < self.min_chunk):
            next_ = self.queue.pop(0)
            self.head = (next_[0], self.head[1] + next_[1])
            self.merged = True

    def count_from(self, time):
        if paths.holds(self.head[0] > time):
            return
        self.head = (time, self.head[1])
        while self.queue and paths.holds(self.queue[0][0] <= time):
            next_ = self.queue.pop(0)
            self.head = (self.head[0], self.head[1] + next_[1])

    def push(self, chunk):
        full = len(self.queue) >= self.limit
        time, amount = self.queue[-1] if self.queue else self.head
        equal = paths.holds(time == chunk[0])
        if full or equal:
            self.merged = self.merged or not equal
            youngest = (chunk[0], amount + chunk[1])
            if self.queue:
                self.queue[-1] = youngest
            else:
                self.head = youngest
        else:
            self.queue.append(chunk)

    def activate(self, now):
        self.count_from(self.see(now))

    def block(self, now):
        self.see(now)

    def update(self, now):
        return HIGH if paths.holds(self.head[0] <= self.see(now)) else LOW

    def available(self, now):
        now = larger(self.clock, now)
        if paths.holds(self.head[0] > now):
            return 0
        total = self.head[1]
        for time, amount in self.queue:
            if not paths.holds(time <= now):
                break
            total = total + amount
        return total

    def next_replenishment(self):
        return self.head[0] if paths.holds(self.head[0] > self.clock) else None


class Reservation:
    """reservation.rs"""

    def __init__(self, server, slack, min_rearm, max_backoff, now, cpu):
        self.server = server
        self.slack, self.min_rearm, self.max_backoff = slack, min_rearm, max_backoff
        self.runnable, self.level = False, HIGH
        self.cpu_mark, self.read_at = cpu, now
        self.check_at, self.backoff, self.advance = NEVER, 0, 0
        self.retries = False  # the code's `refused`
        self.cpu_high, self.cpu_low, self.inside, self.owed = 0, 0, 0, 0
        self.charged = 0  # a ghost: all that the server was charged

    def longest_backoff(self):
        quarter = paths.divide(self.server.budget, 4)[0]
        return smaller(larger(quarter, 5 * self.min_rearm), self.max_backoff)

    def charge(self, used, now):
        self.charged = self.charged + used
        self.server.charge(used, now)

    def activate(self, woken, now, cpu):
        self.runnable = True
        self.server.activate(smaller(larger(woken, self.read_at), now))
        self.backoff = 0
        self.account(now, cpu, [])
        self.replan(now)

    def block(self, now, cpu, readings):
        self.account(now, cpu, readings)
        self.server.block(now)
        self.runnable = False
        self.replan(now)

    def judge(self, now, cpu, readings):
        retried, self.retries = self.retries, False
        if self.sleeps_funded() or (retried and self.sleeps_high()):
            self.check_at = NEVER
            return None
        elapsed = minus(now, self.read_at)
        used = minus(cpu, self.cpu_mark)
        self.check_at = NEVER
        funded = self.level == HIGH
        self.account(now, cpu, readings)
        if funded and self.runnable and paths.holds(used < paths.divide(elapsed, 8)[0]):
            doubled = larger(self.backoff * 2, self.min_rearm * 2)
            self.backoff = smaller(doubled, self.longest_backoff())
        else:
            self.backoff = 0
        return self.decide(now)

    def observe(self, now, cpu, readings):
        if not self.sleeps_funded():
            self.account(now, cpu, readings)
            self.replan(now)

    def owe(self, amount, now):
        self.charge(amount, now)
        self.owed = self.owed + amount

    def applied(self, level, now, cpu):
        self.account(now, cpu, [])
        before, self.level = self.level, level
        if before == level:
            return
        self.check_at = NEVER
        self.retries = False
        self.backoff = 0
        self.replan(now)

    def refused(self, now):
        if self.level == HIGH:
            pause = self.longest_backoff()
        else:
            pause = larger(smaller(paths.divide(self.server.period, 2)[0], 100_000_000), self.max_backoff)
        self.check_at = now + pause
        self.retries = True

    def pull_in(self, now):
        if paths.holds(self.backoff == 0) or not self.runnable or self.level == LOW:
            return
        self.backoff = 0
        self.plan(now)

    def sleeps_funded(self):
        return self.sleeps_high() and paths.holds(self.server.available(self.read_at) > 0)

    def sleeps_high(self):
        return not self.runnable and self.level == HIGH

    def account(self, now, cpu, readings):
        """`readings`: a list of intervals (ran, out_at, in_at), or None for unknown."""
        used = minus(cpu, self.cpu_mark)
        self.cpu_mark = larger(self.cpu_mark, cpu)
        self.read_at = larger(self.read_at, now)
        rest = used if self.level == HIGH else 0
        self.cpu_high = self.cpu_high + rest
        self.cpu_low = self.cpu_low + used - rest
        if self.runnable:
            if readings is None:
                self.server.activate(minus(now, used))
            else:
                for ran, out_at, in_at in readings:
                    ran = smaller(ran, rest)
                    rest = rest - ran
                    due = self.unpaid(ran)
                    self.charge(due, out_at)
                    self.server.block(out_at)
                    self.server.activate(in_at)
                    self.inside = self.inside + 1
        if self.level == LOW:
            return
        due = self.unpaid(rest)
        funded = self.server.available(now)
        left = minus(funded, due)
        if paths.holds(due > 0) and paths.holds(left <= self.slack) and self.runnable:
            self.advance = left
            self.charge(due + left, now)
        else:
            self.charge(due, now)

    def unpaid(self, used):
        paid = smaller(self.advance, used)
        self.advance = self.advance - paid
        return used - paid

    def left(self, now):
        return self.server.available(now) + self.advance

    def decide(self, now):
        want = self.server.update(now)
        if want != self.level:
            return want
        self.plan(now)
        return None

    def replan(self, now):
        if self.server.update(now) == self.level:
            self.retries = False
            self.plan(now)
        elif not self.retries:
            self.check_at = now

    def plan(self, now):
        if self.level == LOW:
            wanted = self.server.next_replenishment()
            wanted = NEVER if wanted is None else wanted
        elif self.runnable:
            wanted = now + larger(larger(self.left(now), self.min_rearm), self.backoff)
        else:
            return
        self.check_at = smaller(self.check_at, wanted)
