//! [`Allowance`]: the CPU time that the dispatcher spends on what it hears of other participants.
//!
//! A network that starts all at once announces thousands of endpoints in a moment. Datagrams over
//! the allowance wait in the sockets of discovery, and samples have their turn. The kernel may drop
//! some: participants announce themselves again, and announcements of endpoints are reliable.

use crate::Nanos;

/// Windows begin on a grid of this length.
const WINDOW: Nanos = 20_000_000;
/// CPU time in each. An interval of 100 ms meets six windows: 3.6 ms, and room for answers.
const TIME: Nanos = 600_000;

/// The CPU time that is left for discovery.
#[derive(Debug, Default)]
pub(super) struct Allowance {
    /// The number of the window.
    window: Nanos,
    spent: Nanos,
}

impl Allowance {
    /// CPU time was spent on discovery.
    pub(super) fn spend(&mut self, time: Nanos, now: Nanos) {
        if self.window != now / WINDOW {
            (self.window, self.spent) = (now / WINDOW, 0);
        }
        self.spent = self.spent.saturating_add(time);
    }

    /// When discovery goes on, if nothing is left now.
    pub(super) fn resumes_at(&self, now: Nanos) -> Option<Nanos> {
        let is_spent = self.window == now / WINDOW && self.spent >= TIME;
        is_spent.then(|| (self.window + 1).saturating_mul(WINDOW))
    }
}

#[test]
fn what_is_over_the_allowance_waits_for_the_next_window() {
    let mut allowance = Allowance::default();
    let begin = 1000 * WINDOW;
    assert_eq!(allowance.resumes_at(begin), None);
    allowance.spend(TIME - 1, begin);
    assert_eq!(allowance.resumes_at(begin), None);
    allowance.spend(1, begin + 5);
    assert_eq!(allowance.resumes_at(begin + 6), Some(begin + WINDOW));
    assert_eq!(allowance.resumes_at(begin + WINDOW), None);
    allowance.spend(1, begin + WINDOW);
    assert_eq!(allowance.resumes_at(begin + WINDOW), None);
}

/// However the windows lie, whoever asks before each datagram stays below 5 ms in 100 ms.
#[test]
fn no_100_ms_have_5_ms_of_discovery() {
    let (mut allowance, mut now) = (Allowance::default(), 7);
    let (cost, mut spent) = (20_000, Vec::new());
    while now < 50 * WINDOW {
        if let Some(at) = allowance.resumes_at(now) {
            now = at;
            continue;
        }
        spent.push(now);
        now += cost;
        allowance.spend(cost, now);
    }
    for from in &spent {
        let within = spent
            .iter()
            .filter(|at| (*from..from + 100_000_000).contains(*at));
        let time = within.count() as u64 * cost;
        assert!(time < 5_000_000, "{time} ns from {from} on");
    }
    assert!(spent.len() as u64 * cost > 49 * TIME, "all of it is used");
}
