//! The log of what the agent refuses: one line each, but bounded, whatever peers do.
//!
//! ```text
//!   window of 10 s ── 5 lines of each kind, the rest counted ──► "... 1234 more"
//!        ▲    └─ there was more: the next window is twice as long, up to 20 min
//!        └────── there was not: 10 s again
//! ```
//!
//! So a flood that goes on costs six lines of its kind in 20 minutes.

use crate::time::{Nanos, SEC};
use replenish_agent::Rejections;
use std::collections::BTreeMap;

/// Lines of one kind in a window.
const LINES: u64 = 5;

/// The shortest window, and the longest.
const WINDOW: Nanos = 10 * SEC;
const LONGEST: Nanos = 1200 * SEC;

/// The number of logged messages of each kind.
#[derive(Debug, Default)]
pub(super) struct Log {
    kinds: BTreeMap<&'static str, Kind>,
    /// Rejections of each kind so far.
    totals: BTreeMap<&'static str, u64>,
}

#[derive(Debug)]
struct Kind {
    ends: Nanos,
    window: Nanos,
    shown: u64,
    hidden: u64,
}

impl Log {
    /// The lines that `rejections` are worth at `now`.
    pub(super) fn lines(&mut self, rejections: &Rejections, now: Nanos) -> Vec<String> {
        let mut lines = Vec::new();
        for (name, count) in &rejections.omitted {
            *self.totals.entry(name).or_default() += count;
        }
        for rejection in &rejections.list {
            let name = rejection.reason.kind();
            *self.totals.entry(name).or_default() += 1;
            lines.extend(self.line(name, || rejection.to_string(), now));
        }
        for (name, count) in &rejections.omitted {
            if let Some(kind) = self.kinds.get_mut(name) {
                kind.hidden += count;
            }
        }
        lines.extend(self.windows_over(now));
        lines
    }

    /// Writes one line of a kind, unless there were too many of it; then it is counted.
    pub(super) fn line(
        &mut self,
        name: &'static str,
        text: impl FnOnce() -> String,
        now: Nanos,
    ) -> Option<String> {
        let kind = self.kinds.entry(name).or_insert(Kind {
            ends: now.saturating_add(WINDOW),
            window: WINDOW,
            shown: 0,
            hidden: 0,
        });
        if kind.shown < LINES {
            kind.shown += 1;
            return Some(text());
        }
        kind.hidden += 1;
        None
    }

    /// Closes the windows that are over; what they have hidden.
    fn windows_over(&mut self, now: Nanos) -> Vec<String> {
        let mut lines = Vec::new();
        self.kinds.retain(|name, kind| {
            if now < kind.ends {
                return true;
            }
            if kind.hidden == 0 {
                return false;
            }
            lines.push(kind.summary(name));
            kind.window = kind.window.saturating_mul(2).min(LONGEST);
            kind.ends = now.saturating_add(kind.window);
            (kind.shown, kind.hidden) = (0, 0);
            true
        });
        lines
    }

    /// The messages that were hidden and not reported yet, at the end.
    pub(super) fn rest(&mut self) -> Vec<String> {
        let kinds = std::mem::take(&mut self.kinds);
        let hidden = kinds.iter().filter(|(_, kind)| kind.hidden > 0);
        hidden.map(|(name, kind)| kind.summary(name)).collect()
    }

    /// Number of rejections by kind.
    pub(super) fn totals(&self) -> &BTreeMap<&'static str, u64> {
        &self.totals
    }
}

impl Kind {
    fn summary(&self, name: &str) -> String {
        format!("{} more of kind {name} were not logged", self.hidden)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_agent::{Reason, Rejection};

    fn flood(count: u64) -> Rejections {
        let rejection = Rejection {
            at: 0,
            peer: "udp 127.0.0.1:1".into(),
            key: None,
            about: None,
            reason: Reason::Malformed { bytes: 3 },
        };
        Rejections {
            list: vec![rejection; 32],
            omitted: vec![("malformed", count - 32)],
        }
    }

    #[test]
    fn a_flood_of_a_day_is_worth_some_hundred_lines_and_is_counted() {
        let mut log = Log::default();
        let mut lines = 0;
        for second in 0..86_400 {
            lines += log.lines(&flood(100_000), second * SEC).len();
        }
        let rest = log.rest();
        assert_eq!(rest.len(), 1);
        assert!((400..600).contains(&lines), "{lines}");
        assert_eq!(log.totals().get("malformed"), Some(&8_640_000_000));
    }

    #[test]
    fn what_is_hidden_is_told_and_a_quiet_window_forgets() {
        let mut log = Log::default();
        assert_eq!(log.lines(&flood(100), 0).len(), 5);
        let over = log.lines(&Rejections::default(), WINDOW);
        assert_eq!(over, ["95 more of kind malformed were not logged"]);
        assert_eq!(log.lines(&Rejections::default(), 3 * WINDOW), [""; 0]);
        assert!(log.kinds.is_empty());
        assert_eq!(log.lines(&flood(32), 4 * WINDOW).len(), 5);
    }
}
