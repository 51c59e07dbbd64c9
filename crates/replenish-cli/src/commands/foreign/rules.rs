//! Rules that give threads their budgets: patterns for names, and amounts.

use crate::outcome::Failure;
use crate::time::Nanos;
use replenish_os::foreign::fits;
use replenish_os::{SchedClass, Tid};
use replenish_plan::{Requirement, span};
use sporadic::{Low, Params, Policy};
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
    /// The same as the planner takes it.
    pub(super) fn asked(&self, priority: u8, background: Background) -> Result<Asked, Failure> {
        let amount = self.amount;
        let priority = amount.priority.unwrap_or(priority);
        let low = background.low();
        let params = Params::new(priority, low, amount.amount, amount.period, REPLENISHMENTS);
        let wrong = |e| Failure::Usage(format!("--thread {}: {e}", self.pattern));
        Ok(Asked {
            pattern: self.pattern.clone(),
            scheduling: Requirement::Policy(Policy::Sporadic(params.map_err(wrong)?)),
        })
    }
}

/// Pending replenishments of a budget, as the enforcer keeps them.
const REPLENISHMENTS: u16 = 16;

/// A budget that somebody asks for, by command line or file, before admission.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Asked {
    pub(super) pattern: String,
    pub(super) scheduling: Requirement,
}

/// A budget that was admitted: which threads share it, and how much it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Terms {
    pub(super) pattern: String,
    pub(super) amount: Nanos,
    pub(super) period: Nanos,
    pub(super) priority: u8,
    pub(super) background: Background,
}

impl Terms {
    /// Whether the budget is for this thread.
    pub(super) fn is_about(&self, tid: Tid, name: &str) -> bool {
        match self.pattern.strip_prefix("tid:") {
            Some(number) => number.parse().ok() == Some(tid.get()),
            None => fits(&self.pattern, name),
        }
    }
}

/// A thread without budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Background {
    /// It runs in this class.
    Class(SchedClass),
    /// It is stopped.
    Suspend,
}

impl Background {
    pub(super) const IDLE: Self = Self::Class(SchedClass::Idle);

    /// The class that a thread has; one that is to be stopped has it until it is.
    pub(super) fn class(self) -> SchedClass {
        match self {
            Self::Class(class) => class,
            Self::Suspend => SchedClass::Idle,
        }
    }

    /// Its name in plans and in the ledger, where everything below real-time priority is 0.
    fn low(self) -> Low {
        match self {
            Self::Class(SchedClass::Fifo(low) | SchedClass::RoundRobin(low)) => {
                Low::Background(low)
            }
            Self::Class(SchedClass::Idle | SchedClass::Other) => Low::Background(0),
            Self::Suspend => Low::Suspend,
        }
    }

    /// The background of a plan; `usual` where the plan leaves it to the kernel.
    pub(super) fn of(low: Low, usual: Self) -> Self {
        match low {
            Low::Background(0) => usual,
            Low::Background(low) => Self::Class(SchedClass::Fifo(low)),
            Low::Suspend => Self::Suspend,
        }
    }
}

impl FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("idle", _) => Ok(Self::IDLE),
            ("other", _) => Ok(Self::Class(SchedClass::Other)),
            ("suspend", _) => Ok(Self::Suspend),
            (_, Ok(priority @ 1..=97)) => Ok(Self::Class(SchedClass::Fifo(priority))),
            _ => Err("allowed is idle, other, suspend, or a FIFO priority from 1 to 97".into()),
        }
    }
}

impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Suspend => f.write_str("suspend"),
            Self::Class(SchedClass::Idle) => f.write_str("idle"),
            Self::Class(SchedClass::Fifo(priority)) => write!(f, "{priority}"),
            Self::Class(SchedClass::Other | SchedClass::RoundRobin(_)) => f.write_str("other"),
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
        assert!("tid:7=1ms/10ms".parse::<Rule>().is_ok());
        let by_number = Terms {
            pattern: "tid:7".into(),
            amount: 1,
            period: 2,
            priority: 1,
            background: Background::IDLE,
        };
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
        assert_eq!("7".parse(), Ok(Background::Class(SchedClass::Fifo(7))));
        assert_eq!("suspend".parse(), Ok(Background::Suspend));
        assert!("98".parse::<Background>().is_err());
    }
}
