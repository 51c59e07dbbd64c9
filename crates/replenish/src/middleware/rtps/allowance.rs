//! [`Allowance`]: the CPU time that the dispatcher spends on what other participants ask of it, in
//! discovery and for repairs.
//!
//! A network that starts all at once announces thousands of endpoints in a moment, and a reader
//! behind a bad link asks for everything twice. Datagrams over an allowance wait in their sockets,
//! answers wait in the participant, and samples have their turn. The kernel may drop some
//! datagrams: participants announce themselves again, announcements of endpoints are reliable, and
//! an acknowledgement says all that earlier ones said.

use crate::Nanos;

/// Windows begin on a grid of this length.
const WINDOW: Nanos = 20_000_000;
/// CPU time for discovery in each. An interval of 100 ms meets six windows: 3.3 ms, and room for
/// the datagram that each of them ends with, and for the waits between.
const DISCOVERY: Nanos = 550_000;
/// CPU time in each for acknowledgements that are heard and for what is sent again: a tenth of a
/// CPU.
const REPAIRS: Nanos = 2_000_000;

/// The CPU time that is left for one purpose.
///
/// One datagram can bring the announcements of many endpoints that waited for it. What it takes
/// beyond the allowance is a debt of the next windows.
#[derive(Debug)]
pub(super) struct Allowance {
    /// CPU time in each window.
    time: Nanos,
    /// The number of the window.
    window: Nanos,
    spent: Nanos,
}

impl Allowance {
    const fn new(time: Nanos) -> Self {
        Self {
            time,
            window: 0,
            spent: 0,
        }
    }

    /// For what is heard of other participants, and for what is sent to them.
    pub(super) const fn for_discovery() -> Self {
        Self::new(DISCOVERY)
    }

    /// For the acknowledgements of others' readers, and for samples that they ask for again.
    pub(super) const fn for_repairs() -> Self {
        Self::new(REPAIRS)
    }

    /// CPU time was spent.
    pub(super) fn spend(&mut self, time: Nanos, now: Nanos) {
        self.spent = self.spent_at(now).saturating_add(time);
        self.window = now / WINDOW;
    }

    /// When there is time again, if nothing is left now.
    pub(super) fn resumes_at(&self, now: Nanos) -> Option<Nanos> {
        let windows = self.spent_at(now) / self.time;
        let resumes = (now / WINDOW).saturating_add(windows);
        (windows > 0).then(|| resumes.saturating_mul(WINDOW))
    }

    /// CPU time of this window that is spent, debts included.
    fn spent_at(&self, now: Nanos) -> Nanos {
        let passed = (now / WINDOW).saturating_sub(self.window);
        self.spent.saturating_sub(passed.saturating_mul(self.time))
    }
}

#[test]
fn what_is_over_the_allowance_waits_for_the_next_window() {
    let mut allowance = Allowance::for_discovery();
    let begin = 1000 * WINDOW;
    assert_eq!(allowance.resumes_at(begin), None);
    allowance.spend(DISCOVERY - 1, begin);
    assert_eq!(allowance.resumes_at(begin), None);
    allowance.spend(1, begin + 5);
    assert_eq!(allowance.resumes_at(begin + 6), Some(begin + WINDOW));
    assert_eq!(allowance.resumes_at(begin + WINDOW), None);
    allowance.spend(1, begin + WINDOW);
    assert_eq!(allowance.resumes_at(begin + WINDOW), None);
}

#[test]
fn a_datagram_that_takes_long_is_a_debt() {
    let mut allowance = Allowance::for_discovery();
    let begin = 1000 * WINDOW;
    allowance.spend(3 * DISCOVERY + 5, begin);
    assert_eq!(allowance.resumes_at(begin), Some(begin + 3 * WINDOW));
    assert_eq!(
        allowance.resumes_at(begin + 2 * WINDOW + 1),
        Some(begin + 3 * WINDOW)
    );
    assert_eq!(allowance.resumes_at(begin + 3 * WINDOW), None);
    allowance.spend(DISCOVERY - 6, begin + 3 * WINDOW);
    assert_eq!(allowance.resumes_at(begin + 3 * WINDOW), None);
    allowance.spend(1, begin + 3 * WINDOW);
    let next = Some(begin + 4 * WINDOW);
    assert_eq!(allowance.resumes_at(begin + 3 * WINDOW), next);
}

/// However the windows lie, whoever asks before each datagram stays below 5 ms in 100 ms, also
/// where every 40th datagram takes 0.5 ms.
#[test]
fn no_100_ms_have_5_ms_of_discovery() {
    let (mut allowance, mut now) = (Allowance::for_discovery(), 7);
    let mut spent = Vec::new();
    while now < 50 * WINDOW {
        if let Some(at) = allowance.resumes_at(now) {
            now = at;
            continue;
        }
        let cost = if spent.len() % 40 == 39 {
            500_000
        } else {
            20_000
        };
        spent.push((now, cost));
        now += cost;
        allowance.spend(cost, now);
    }
    for (from, _) in &spent {
        let within = spent
            .iter()
            .filter(|(at, _)| (*from..from + 100_000_000).contains(at));
        let time: u64 = within.map(|(_, cost)| cost).sum();
        assert!(time < 5_000_000, "{time} ns from {from} on");
    }
    let all: u64 = spent.iter().map(|(_, cost)| cost).sum();
    assert!(all > 49 * DISCOVERY, "all of it is used");
}
