//! Never too much: the fullest window, and the fullest time since some moment.

use super::super::timeline::PUNCTUAL;
use super::Finding;
use super::finding::{LATE, latency};
use super::view::View;
use crate::load::Nanos;
use sporadic::Tuning;

/// A stretch at high priority, and the last moment before it at which the thread had none waiting.
#[derive(Clone, Copy)]
struct High {
    anchor: Nanos,
    from: Nanos,
    to: Nanos,
    cpu: Nanos,
    /// Beyond the bound: of this time, and what led to it, the machine stood still for so long, and
    /// interrupts made a section so much longer.
    beyond: Nanos,
}

/// Sums over the first so many stretches.
struct Sums(Vec<Nanos>);

impl Sums {
    fn of(all: &[High], what: impl Fn(&High) -> Nanos) -> Self {
        let mut sum = 0;
        let rest = all.iter().map(|piece| {
            sum += what(piece);
            sum
        });
        Self(std::iter::once(0).chain(rest).collect())
    }

    fn between(&self, first: usize, end: usize) -> Nanos {
        let at = |index: usize| self.0.get(index).copied().unwrap_or(0);
        at(end).saturating_sub(at(first))
    }
}

/// The debt of the machine that stood still: `docs/servers.md` proves that what is left of it is
/// all that a thread may have beyond its bound.
#[derive(Default)]
struct Debt {
    /// In units of 1/T: nothing is rounded.
    left: u128,
    at: Nanos,
}

impl Debt {
    /// Up to that time it is paid back at B/T.
    fn pay(&mut self, at: Nanos, budget: Nanos) {
        let paid = u128::from(at.saturating_sub(self.at)) * u128::from(budget);
        self.left = self.left.saturating_sub(paid);
        self.at = at;
    }

    /// It grows; the sum.
    fn owe(&mut self, more: Nanos, period: Nanos) -> Nanos {
        self.left += u128::from(more) * u128::from(period);
        Nanos::try_from(self.left.div_ceil(u128::from(period))).unwrap_or(Nanos::MAX)
    }
}

impl View<'_> {
    /// The stretches at high priority, from the first anchor on.
    fn high(&self) -> Vec<High> {
        let timeline = &self.evidence.timeline;
        let mut anchor = None;
        let mut all: Vec<High> = Vec::new();
        let mut counted = 0;
        let mut judged = 0;
        for p in self.pieces() {
            if p.withheld {
                judged = timeline.judged_until(p.to);
            }
            if self.is_high(p) {
                let mut beyond = 0;
                // Its stated length knows no interrupts.
                if self.worker.group.is_some() && p.rank != self.worker.priority && !p.waits {
                    beyond += PUNCTUAL.min(p.cpu);
                }
                // A thread is charged for a switch in which the machine stood still before it.
                for (began, ended) in timeline.still_in(p.from.saturating_sub(LATE), p.to + LATE) {
                    if began >= counted {
                        beyond += ended - began;
                        counted = ended;
                    }
                }
                all.extend(anchor.map(|anchor| High {
                    anchor,
                    from: p.from,
                    to: p.to,
                    cpu: p.cpu,
                    beyond,
                }));
            } else if p.rank < self.worker.priority
                && !p.withheld
                && p.to > p.from
                && !self.settles(p.to)
                // An event that fell due while the machine stood still, or while the kernel kept
                // the enforcer waiting, is yet to come.
                && timeline.stood_still(p.to.saturating_sub(LATE), p.to) == 0
                && judged + LATE <= p.to
            {
                anchor = Some(p.to);
            }
        }
        all
    }

    /// The fullest window, and the fullest time since some moment, of a worker that may inherit so
    /// much.
    pub(super) fn upper(&self, inherits: Nanos) -> [Finding; 2] {
        let (budget, period) = (self.worker.budget, self.worker.period);
        // While it makes no progress its checks are put off (docs/servers.md, the stated latency).
        let put_off = Tuning::LINUX.backoff(budget);
        let bound = budget + inherits + latency(budget) + put_off;
        let high = self.high();
        let (used, more) = (Sums::of(&high, |p| p.cpu), Sums::of(&high, |p| p.beyond));
        // Of all anchors so far, the least that had been used by then, less what had come back.
        let balance = |used: Nanos, at: Nanos| {
            let earned = u128::from(at) * u128::from(budget) / u128::from(period);
            i128::from(used) - earned.cast_signed()
        };
        let mut window = self.finding("window", bound, 0, 0);
        let mut rate = self.finding("rate", bound, 0, 0);
        let (mut anchor, mut end, mut least) = (None, 0, i128::MAX);
        let mut debt = Debt::default();
        for (index, piece) in high.iter().enumerate() {
            if anchor != Some(piece.anchor) {
                anchor = Some(piece.anchor);
                let until = piece.anchor + period;
                while high.get(end).is_some_and(|p| p.from < until) {
                    end += 1;
                }
                let beyond = match end.checked_sub(1).and_then(|last| high.get(last)) {
                    Some(last) if last.to > until => last.cpu.saturating_sub(until - last.from),
                    _ => 0,
                };
                let sum = used.between(index, end).saturating_sub(beyond);
                let allowed = bound + more.between(index, end);
                let found = self.finding("window", allowed, sum, piece.anchor);
                if found.beyond() > window.beyond() {
                    window = found;
                }
                least = least.min(balance(used.between(0, index), piece.anchor));
            }
            let since = balance(used.between(0, index + 1), piece.to) - least;
            let since = u64::try_from(since).unwrap_or(0);
            debt.pay(piece.to, budget);
            let allowed = bound + debt.owe(piece.beyond, period);
            let found = self.finding("rate", allowed, since, piece.from);
            if found.beyond() > rate.beyond() {
                rate = found;
            }
        }
        [window, rate]
    }
}
