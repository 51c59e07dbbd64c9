"""The mutants of `mutants.py`, by group: a crate, what of it is built, and the tests that must notice.

A mutant is a name, a file, a text that is there exactly once, and the text in its place. A fifth
entry says why no test can tell it from the code: then it must survive. Mutants of the theorem's model
are in `proofs/mutants.py`.
"""

BEFORE = "31 of 52 were killed when this list was begun (issue 20)"

RESERVATION = "crates/sporadic/src/reservation.rs"
CORRECTED = "crates/sporadic/src/corrected.rs"
POSIX = "crates/sporadic/src/posix.rs"
OUTPUT = "crates/replenish-xrce/src/stream/output_reliable.rs"
INPUT = "crates/replenish-xrce/src/stream/input_reliable.rs"
RING = "crates/replenish-xrce/src/stream/ring.rs"
RTT = "crates/replenish-xrce/src/stream/rtt.rs"
OVERRUNS = "crates/replenish-os/src/enforcer/overruns.rs"
INTERVALS = "crates/replenish-os/src/linux/blocked_intervals.rs"
ALARM = "crates/replenish-os/src/enforcer/alarm.rs"
PLANNER = "crates/replenish-plan/src/planner"
EXECUTOR = "crates/replenish/src/executor"

SPORADIC = [
    ("a wake-up before the last reading", RESERVATION,
     "activate(earliest(latest(woken, self.read_at), now))", "activate(earliest(woken, now))"),
    ("a wake-up after now", RESERVATION,
     "activate(earliest(latest(woken, self.read_at), now))", "activate(latest(woken, self.read_at))"),
    ("idle below a quarter", RESERVATION, "used < elapsed / 8", "used < elapsed / 4"),
    ("idle below a sixteenth", RESERVATION, "used < elapsed / 8", "used < elapsed / 16"),
    ("idle at an eighth", RESERVATION, "used < elapsed / 8", "used <= elapsed / 8"),
    ("checks without progress do not double", RESERVATION,
     "(self.backoff * 2).max(", "self.backoff.max("),
    ("checks without progress double for ever", RESERVATION,
     "self.backoff = earliest(doubled, longest);", "let _ = longest;\n            self.backoff = doubled;"),
    ("a free CPU does not pull a check in", RESERVATION,
     "        self.backoff = 0;\n        let before", "        let before"),
    ("a refused raise waits for a quarter of the period", RESERVATION,
     ".min(params.period() / 2)", ".min(params.period() / 4)"),
    ("slack up to a hundredth of the budget", RESERVATION, "budget / 200", "budget / 100"),
    ("what is owed is not counted", RESERVATION, "        self.counters.owed += amount;\n", ""),
    ("a limit below the shortest check", RESERVATION,
     "latest(left, self.tuning.min_rearm)))", "left))"),
    ("an overrun forgives a period", CORRECTED,
     "let delay = rounds.saturating_mul(period);", "let delay = (rounds - 1).saturating_mul(period);"),
    ("budget that is due now is not available", CORRECTED,
     "take_while(|chunk| chunk.time <= now)", "take_while(|chunk| chunk.time < now)"),
    ("High a moment late", CORRECTED, "if self.head.time <= self.see(now)", "if self.head.time < self.see(now)"),
    ("the clock goes back", CORRECTED,
     "    fn see(&mut self, now: Nanos) -> Nanos {\n        self.clock = latest(self.clock, now);",
     "    fn see(&mut self, now: Nanos) -> Nanos {\n        self.clock = now;"),
    ("one replenishment more than may be pending", CORRECTED,
     "self.queue.len() >= limit", "self.queue.len() > limit"),
    ("POSIX: due now before a charge", POSIX,
     "self.replenish(now, |time| time < now)", "self.replenish(now, |time| time <= now)"),
    ("POSIX: a raise keeps the old activation", POSIX,
     "            self.activation_time = now;\n        }\n    }\n\n    /// R6",
     "        }\n    }\n\n    /// R6"),
    ("POSIX: more than the budget is given back", POSIX,
     "self.avail.saturating_add(amount).min(self.params.budget())",
     "self.avail.saturating_add(amount)"),
]

XRCE = [
    ("a duplicate is not answered at once", INPUT,
     "            self.urgent = true; // the acknowledgement was lost\n", ""),
    ("a gap is not answered at once", INPUT,
     "        if ahead > 0 {\n            self.urgent = true;\n", "        if ahead > 0 {\n"),
    ("a heartbeat is not answered at once", INPUT,
     "        self.ack_due = true;\n        self.urgent = true;\n    }", "        self.ack_due = true;\n    }"),
    ("a bitmap of fifteen", INPUT, ".wrapping_add(1)).min(16);", ".wrapping_add(1)).min(15);"),
    ("announced survives a reset", INPUT,
     "        self.announced = SeqNum(0).previous();\n        self.taken = 0;", "        self.taken = 0;"),
    ("kept messages survive a reset", INPUT,
     "    pub fn reset(&mut self) {\n        self.kept = 0;", "    pub fn reset(&mut self) {"),
    ("announced goes back", INPUT,
     "    pub fn heartbeat(&mut self, last: SeqNum) {\n        if last.is_after(self.announced) {",
     "    pub fn heartbeat(&mut self, last: SeqNum) {\n        if last.is_after(self.next) {"),
    ("an acknowledgement waits for one message more", INPUT,
     "self.unconfirmed >= self.policy.every", "self.unconfirmed > self.policy.every"),
    ("an acknowledgement waits for ever", INPUT,
     "            self.ack_at = at;\n            return None;", "            return None;"),
    ("a bitmap of fifteen is understood", OUTPUT,
     "let known = known.min(self.sent.saturating_sub(first));",
     "let known = known.min(15).min(self.sent.saturating_sub(first));"),
    ("repairs are not repeated", OUTPUT, "if !new && slot.retries < RETRIES", "if false && slot.retries < RETRIES"),
    ("repairs are repeated for ever", OUTPUT, "if !new && slot.retries < RETRIES", "if !new"),
    ("repairs at the same pace", OUTPUT, "(0..slot.retries).fold(now", "(0..1_u8).fold(now"),
    ("repetitions do not begin anew", OUTPUT, "                slot.retries = 0;\n", ""),
    ("messages that were not sent are acknowledged", OUTPUT,
     "if acked > self.sent {", "if acked > self.ring.used {"),
    ("what was not acknowledged is confirmed", OUTPUT,
     "if confirmed > self.acked {", "if confirmed > self.sent {"),
    ("confirmations go back", OUTPUT,
     "self.confirmed = self.confirmed.max(confirmed);", "self.confirmed = confirmed;"),
    ("heartbeats never slow down", OUTPUT, "if self.unanswered >= STEADY {", "if false {"),
    ("heartbeats slow down at once", OUTPUT, "const STEADY: u8 = 3;", "const STEADY: u8 = 1;"),
    ("heartbeats stay slow", OUTPUT,
     "        if newly_acked > 0 {\n            self.unanswered = 0;",
     "        if newly_acked > 1000 {\n            self.unanswered = 0;"),
    ("the steady pace is forgotten", OUTPUT,
     "        if newly_acked > 0 {\n            self.unanswered = 0;", "        if newly_acked > 0 {"),
    ("without Karn's rule", OUTPUT, "filter(|_| RTT && !progress.again)", "filter(|_| RTT)"),
    ("nothing counts as sent twice", OUTPUT, "slot.resent = !new;", "slot.resent = false;"),
    ("received is marked missing", OUTPUT, "                && !slot.received\n", ""),
    ("more in flight than may be", OUTPUT, "in_flight < window;", "in_flight <= window;"),
    ("a lost message waits for new ones", OUTPUT,
     "slot.lost <= now)", "slot.lost < now)"),
    ("the round trip is never forgotten", OUTPUT,
     "        self.asked_at = 0;\n        self.rtt = Rtt::default();", "        self.asked_at = 0;"),
    ("a message is appended to a sent one", OUTPUT, "        slot.open = false;\n", ""),
    ("half a fragment's sample is released", RING,
     "matches!(slot.part, Part::Whole | Part::Last)", "matches!(slot.part, Part::Whole | Part::First)"),
    ("a round trip without variation", RTT, "None => (rtt, rtt / 3),", "None => (rtt, 0),"),
]

ENFORCER = [
    ("a stall from its limit on", OVERRUNS, "if late > STALL {", "if late >= STALL {"),
    ("the least stall is the worst", OVERRUNS, "late > w.late", "late < w.late"),
    ("a stall is an overrun, too", OVERRUNS,
     "                self.worst = Some(stall);\n            }\n            return;",
     "                self.worst = Some(stall);\n            }"),
    ("percentiles a rank too low", OVERRUNS,
     "(sample.len() * percent).div_ceil(100)", "(sample.len() * percent / 100)"),
    ("the newest overrun is not kept", OVERRUNS,
     "usize::try_from(self.count % KEPT as u64)", "usize::try_from(self.count.min(KEPT as u64 - 1))"),
    ("a refused timer counts as set", ALARM,
     "            arm(at)?;\n            self.0 = at;", "            self.0 = at;\n            arm(at)?;"),
    ("a timer that fired counts as set", ALARM,
     "    pub(crate) const fn fired(&mut self) {\n        self.0 = NEVER;",
     "    pub(crate) const fn fired(&mut self) {"),
    ("a timer is set later", ALARM, "if at < self.0 {", "if at != self.0 {"),
]

PLAN = [
    ("a lower level for an earlier deadline", f"{PLANNER}/priorities.rs",
     "high.saturating_sub(u8::try_from(down)", "low.saturating_add(u8::try_from(down)"),
    ("equal deadlines get two levels", f"{PLANNER}/priorities.rs", "    distinct.dedup();\n", ""),
    ("a newcomer on the wrong side", f"{PLANNER}/priorities.rs",
     "let side = if *other < deadline { -1 } else { 1 };", "let side = if *other < deadline { 1 } else { -1 };"),
    ("a level that another has", f"{PLANNER}/priorities.rs", "*d != deadline", "*d == deadline"),
    ("everything on the CPU is reserved", f"{PLANNER}/cpu.rs",
     "trial.plan.share > machine.real_time_share + 1e-9", "trial.plan.share > 2.0"),
    ("a promise is not kept", f"{PLANNER}/cpu.rs",
     "    if let Some(broken) = promised.filter_map(late).next() {\n        return Some(broken);\n    }\n",
     "    let _ = promised;\n"),
    ("the least important grows first", f"{PLANNER}/elastic.rs",
     "(core::cmp::Reverse(importance(i)), *i)", "(importance(i), *i)"),
    ("a rate's budget without what its job needs besides", f"{PLANNER}/tasks.rs",
     "let exact = amount.checked_add(extra)?;", "let exact = amount.checked_add(extra / 1_000)?;"),
    ("locks of one CPU alone", f"{PLANNER}/locks.rs", "&& low != high", "&& low == high && false"),
    ("work of unknown length in a group", f"{PLANNER}/locks.rs",
     "if other.length.is_none() {", "if false && other.length.is_none() {"),
]

SCHEDULE = [
    ("Delay keeps the phase when a period late", f"{EXECUTOR}/wake/schedule.rs",
     "Overrun::Delay if behind >= self.period", "Overrun::Delay if behind > self.period"),
    ("Skip serves the earliest", f"{EXECUTOR}/wake/schedule.rs",
     "let at = due.saturating_add(skipped.saturating_mul(self.period));", "let at = due;"),
    ("a new period counts from now on", f"{EXECUTOR}/wake/schedule.rs",
     "self.next.saturating_sub(self.period).saturating_add(period)", "self.next.saturating_add(period)"),
    ("a cancelled timer is served", f"{EXECUTOR}/wake/schedule.rs",
     ".filter(|_| !self.is_cancelled())?", "?"),
    ("due a moment late", f"{EXECUTOR}/wake/run_queue.rs", "**r <= now", "**r < now"),
    ("a round goes back to earlier handles", f"{EXECUTOR}/wake/run_queue.rs",
     "let mut above = !0 << (from % BITS);", "let mut above = !0;"),
    ("the earliest release is forgotten", f"{EXECUTOR}/wake/run_queue.rs",
     "} else if old <= self.earliest && new != old {", "} else if false {"),
    ("a handle stays due", f"{EXECUTOR}/wake/run_queue.rs", "                *bits &= !(1 << bit);\n", ""),
]

ROUNDS = [
    ("All waits for handles that stopped", f"{EXECUTOR}/run/rounds.rs",
     "all &= entry.ready || !entry.is_live();", "all &= entry.ready;"),
    ("a condition is asked with nothing ready", f"{EXECUTOR}/run/rounds.rs",
     "any && platform::guard(", "platform::guard("),
    ("a due release spins while its trigger waits", f"{EXECUTOR}/run/rounds.rs",
     "        _ => clock::monotonic(),\n    };\n    let live", "        _ => 0,\n    };\n    let live"),
    ("several messages with Logical Execution Time", f"{EXECUTOR}/run/rounds.rs",
     "if batch == 0 || let_ && batch > 1 {", "if batch == 0 {"),
    ("later handles of a priority run first", f"{EXECUTOR}/run/commands.rs",
     "e.handling.priority < priority", "e.handling.priority <= priority"),
    ("described handles of a priority run backwards", f"{EXECUTOR}/run/state.rs",
     "before.handling.priority < entry.handling.priority", "before.handling.priority <= entry.handling.priority"),
    ("a guard is due since its last trigger", f"{EXECUTOR}/handles/guard.rs",
     "inner.since.compare_exchange(0, now, unset, unset).ok();", "inner.since.store(now, unset);"),
    ("a guard is due since its first trigger ever", f"{EXECUTOR}/handles/guard.rs",
     "inner.since.swap(0, Ordering::Relaxed)", "inner.since.load(Ordering::Relaxed)"),
    ("one message in a round", f"{EXECUTOR}/run/worker.rs", "for n in 0..self.batch {", "for n in 0..1_u32 {"),
    ("after a miss everything is left out", f"{EXECUTOR}/handles/entry.rs",
     "        self.skip = false;\n", ""),
    ("after a miss a reply is left out", f"{EXECUTOR}/handles/entry.rs",
     "if !self.skip || self.handle.is_awaited() {", "if !self.skip {"),
    ("the bell is not answered before waiting", f"{EXECUTOR}/run/worker.rs",
     "if self.step(account, &accounting) || self.bell.take() {", "if self.step(account, &accounting) {",
     "the bell is sticky: the wait returns at once, and the round that follows is the same; it costs a "
     "system call, which no test may measure"),
]

GROUPS = [
    {"name": "sporadic", "crate": "sporadic", "target": ["--test", "it"],
     "tests": ["reservation", "corrected_", "posix_", "inherited", "max_repl", "robust", "--skip", "theorem"],
     "mutants": SPORADIC},
    {"name": "xrce streams", "crate": "replenish-xrce", "target": ["--lib", "--test", "it"],
     "tests": ["rtt", "stream_", "session_streams", "session_link"], "mutants": XRCE},
    {"name": "enforcer", "crate": "replenish-os", "target": ["--lib"],
     "tests": ["overruns", "blocked_intervals", "alarm"], "mutants": ENFORCER},
    {"name": "planner", "crate": "replenish-plan", "target": ["--lib", "--test", "it"],
     "tests": ["priorities", "plan::", "groups", "robot"], "mutants": PLAN},
    {"name": "schedule", "crate": "replenish", "target": ["--lib"],
     "tests": ["schedule", "run_queue"], "mutants": SCHEDULE},
    {"name": "rounds", "crate": "replenish", "target": ["--test", "it"],
     "tests": ["rounds", "misses"], "mutants": ROUNDS},
]
