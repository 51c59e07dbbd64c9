//! The rules R1-R7 of POSIX, unit by unit and without any cleverness.

use sporadic::{Level, Nanos};

/// State as the rules name it, plus what tests want to know.
#[derive(Debug, Clone)]
pub struct PosixModel {
    budget: Nanos,
    period: Nanos,
    max_repl: usize,
    pub runnable: bool,
    pub avail: Nanos,
    pub activation_time: Nanos,
    /// One entry per executed unit that is not scheduled for replenishment yet.
    pub executed: Vec<()>,
    /// (due, amount), in order of scheduling.
    pub pending: Vec<(Nanos, Nanos)>,
    /// Whether an overrun was ever forgotten by the clamp.
    pub overran: bool,
}

impl PosixModel {
    pub fn new(budget: Nanos, period: Nanos, max_repl: u16) -> Self {
        Self {
            budget,
            period,
            max_repl: max_repl.into(),
            runnable: false,
            avail: budget,
            activation_time: 0,
            executed: Vec::new(),
            pending: Vec::new(),
            overran: false,
        }
    }

    /// "P iff avail > 0 and #pending < N".
    pub fn level(&self) -> Level {
        if self.avail == 0 || self.pending.len() >= self.max_repl {
            Level::Low
        } else {
            Level::High
        }
    }

    /// The due times at or before `now` (before `now` only if `strictly`), earliest first.
    pub fn pass_time(&mut self, now: Nanos, strictly: bool) {
        loop {
            let due = |&(time, _): &(Nanos, Nanos)| time < now || (time == now && !strictly);
            let Some(next) = self.pending.iter().copied().filter(due).min_by_key(|p| p.0) else {
                return;
            };
            let at = self
                .pending
                .iter()
                .position(|&entry| entry == next)
                .unwrap();
            let was = self.level();
            self.pending.remove(at);
            self.replenish(next.1, was, now);
        }
    }

    /// R7, and R2.
    fn replenish(&mut self, amount: Nanos, was: Level, now: Nanos) {
        for _ in 0..amount {
            if self.avail < self.budget {
                self.avail += 1;
            }
        }
        if self.runnable && was == Level::Low && self.level() == Level::High {
            self.activation_time = now;
        }
    }

    pub fn activate(&mut self, now: Nanos) {
        self.pass_time(now, false);
        self.runnable = true;
        if self.level() == Level::High {
            self.activation_time = now; // R2
        }
    }

    pub fn block(&mut self, now: Nanos) {
        self.runnable = false;
        self.schedule(now); // R4
    }

    /// R3 for each unit; R5 after the last, since the limit is noticed then.
    pub fn charge(&mut self, used: Nanos, now: Nanos) {
        self.pass_time(now, true);
        for _ in 0..used {
            self.executed.push(());
            if self.avail == 0 {
                self.overran = true;
            } else {
                self.avail -= 1;
            }
        }
        if self.avail == 0 {
            self.schedule(now);
        }
    }

    /// R6.
    fn schedule(&mut self, now: Nanos) {
        let amount = self.executed.len() as Nanos;
        self.executed.clear();
        let due = self.activation_time + self.period;
        if amount == 0 {
            return;
        }
        if due < now {
            let was = self.level();
            self.replenish(amount, was, now);
        } else if let Some(same) = self.pending.iter_mut().find(|entry| entry.0 == due) {
            // Charged after the limit was noticed: all that was executed since the activation
            // comes back together.
            same.1 += amount;
        } else {
            self.pending.push((due, amount));
            assert!(self.pending.len() <= self.max_repl, "more than N pending");
        }
    }
}
