//! Which thread gets which budget: patterns for names, and amounts.

use crate::time::Nanos;
use replenish_os::foreign::fits;
use replenish_os::{SchedClass, Tid};
use replenish_plan::span;
use std::str::FromStr;

/// Longest period that makes sense for a budget, in nanoseconds: beyond it the kernel's own
/// throttle of real-time threads (95 % of each second) would end the budget first.
const LONGEST: Nanos = 900_000_000;
/// Shortest period: an enforcer's wake-up costs some ten microseconds.
const SHORTEST: Nanos = 1_000_000;

/// CPU time in every period, at a priority if one is said: `30ms/100ms`, `2ms/10ms@70`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Amount {
    pub(super) amount: Nanos,
    pub(super) period: Nanos,
    pub(super) priority: Option<u8>,
}

impl FromStr for Amount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (spans, priority) = match text.split_once('@') {
            Some((spans, priority)) => {
                let number = priority.trim().parse().ok();
                let number = number.filter(|number| (1..=98).contains(number));
                let refused = || format!("priority {priority:?}: allowed is 1 to 98");
                (spans, Some(number.ok_or_else(refused)?))
            }
            None => (text, None),
        };
        let (amount, period) = spans
            .split_once('/')
            .ok_or("expected TIME/PERIOD, for example 30ms/100ms")?;
        let (amount, period) = (span::parse(amount)?, span::parse(period)?);
        if !(SHORTEST..=LONGEST).contains(&period) {
            return Err("the period must be 1 ms to 900 ms".into());
        }
        if amount < 100_000 || amount > period {
            return Err(format!(
                "the budget must be 100 us to its period, {}",
                span::Exact(period)
            ));
        }
        Ok(Self {
            amount,
            period,
            priority,
        })
    }
}

/// A budget for the threads that a pattern names: `dds.*=2ms/10ms`, `tid:4711=1ms/10ms`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Rule {
    pub(super) pattern: String,
    pub(super) amount: Amount,
}

impl FromStr for Rule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (pattern, amount) = text
            .rsplit_once('=')
            .ok_or("expected PATTERN=TIME/PERIOD, for example 'dds.*=2ms/10ms'")?;
        if pattern.is_empty() || pattern.len() > 64 || pattern.contains(char::is_control) {
            return Err("the pattern must have 1 to 64 characters".into());
        }
        if let Some(tid) = pattern.strip_prefix("tid:")
            && tid.parse().ok().and_then(Tid::new).is_none()
        {
            return Err(format!("{tid:?} is no thread number"));
        }
        Ok(Self {
            pattern: pattern.into(),
            amount: amount.parse()?,
        })
    }
}

impl Rule {
    /// Whether it is about this thread.
    pub(super) fn is_about(&self, tid: Tid, name: &str) -> bool {
        match self.pattern.strip_prefix("tid:") {
            Some(number) => number.parse().ok() == Some(tid.get()),
            None => fits(&self.pattern, name),
        }
    }
}

/// The policy of a thread without budget: `idle`, `other`, or a FIFO priority.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Background(pub(super) SchedClass);

impl FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("idle", _) => Ok(Self(SchedClass::Idle)),
            ("other", _) => Ok(Self(SchedClass::Other)),
            (_, Ok(priority @ 1..=97)) => Ok(Self(SchedClass::Fifo(priority))),
            _ => Err("allowed is idle, other, or a FIFO priority from 1 to 97".into()),
        }
    }
}

impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            SchedClass::Idle => f.write_str("idle"),
            SchedClass::Fifo(priority) => write!(f, "{priority}"),
            SchedClass::Other | SchedClass::RoundRobin(_) => f.write_str("other"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        for (pattern, name) in [
            ("*", ""),
            ("dds.*", "dds.udp.7412"),
            ("*7412", "dds.udp.7412"),
            ("d*s*2", "dds.udp.7412"),
            ("p?thon3", "python3"),
            ("a*b*c", "aXbXbXc"),
        ] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("dds", "dds.udp"), ("?", ""), ("a*b", "aXc"), ("", "x")] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
        // Where a simple matcher takes for ever.
        assert!(!fits(&"*a".repeat(30), &"a".repeat(15)));
    }

    #[test]
    fn amounts_and_rules_are_read_and_refused_by_name() {
        let amount: Amount = "30ms/100ms".parse().unwrap();
        assert_eq!((amount.amount, amount.period), (30_000_000, 100_000_000));
        assert_eq!("2ms/10ms@70".parse::<Amount>().unwrap().priority, Some(70));
        let rule: Rule = "a=b=500us/5ms".parse().unwrap();
        assert_eq!(rule.pattern, "a=b");
        let tid = |n| Tid::new(n).unwrap();
        let by_number: Rule = "tid:7=1ms/10ms".parse().unwrap();
        assert!(by_number.is_about(tid(7), "x") && !by_number.is_about(tid(8), "tid:7"));
        for (bad, part) in [
            ("30ms", "TIME/PERIOD"),
            ("30/100ms", "no unit"),
            ("11ms/10ms", "100 us to its period"),
            ("1us/10ms", "100 us to its period"),
            ("1ms/2s", "1 ms to 900 ms"),
            ("1ms/10ms@99", "1 to 98"),
        ] {
            let refusal = bad.parse::<Amount>().unwrap_err();
            assert!(refusal.contains(part), "{bad}: {refusal}");
        }
        for bad in ["", "x", "=1ms/10ms", "tid:x=1ms/10ms", "a\u{1b}=1ms/10ms"] {
            assert!(bad.parse::<Rule>().is_err(), "{bad:?}");
        }
        assert_eq!("7".parse(), Ok(Background(SchedClass::Fifo(7))));
        assert!("98".parse::<Background>().is_err());
    }
}
