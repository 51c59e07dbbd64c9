//! The corrected server without limits, one entry per nanosecond of budget.

use sporadic::{Level, Nanos};

/// Each unit of budget by itself: the time from which it may be used. No queue, no chunks, no
/// limit on the number of replenishments, no smallest chunk.
#[derive(Debug, Clone)]
pub struct Units {
    pub times: Vec<Nanos>,
    period: Nanos,
}

impl Units {
    pub fn new(budget: Nanos, period: Nanos) -> Self {
        Self {
            times: vec![0; usize::try_from(budget).unwrap()],
            period,
        }
    }

    /// A unit that was available while the thread waited is activated with the thread.
    pub fn activate(&mut self, now: Nanos) {
        for time in &mut self.times {
            if *time <= now {
                *time = now;
            }
        }
    }

    /// Uses the earliest unit, due or not, again and again; returns the activation of each use. A
    /// unit that was due for more than a period when the use began is activated a period before it.
    pub fn charge(&mut self, used: Nanos, now: Nanos) -> Vec<Nanos> {
        self.activate(now.saturating_sub(used).saturating_sub(self.period));
        let mut log = Vec::new();
        for _ in 0..used {
            let earliest = self.times.iter_mut().min().unwrap();
            log.push(*earliest);
            *earliest += self.period;
        }
        log
    }

    pub fn available(&self, now: Nanos) -> Nanos {
        self.times.iter().filter(|&&time| time <= now).count() as Nanos
    }

    pub fn level(&self, now: Nanos) -> Level {
        if self.available(now) > 0 {
            Level::High
        } else {
            Level::Low
        }
    }

    /// In order of time.
    pub fn sorted(&self) -> Vec<Nanos> {
        let mut times = self.times.clone();
        times.sort_unstable();
        times
    }
}
