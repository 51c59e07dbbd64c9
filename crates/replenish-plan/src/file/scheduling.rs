//! Guarantees, policies and releases: from what is written to what is meant.

use super::parse::{Found, Parser};
use super::schema::{self, Kind, Time};
use crate::Machine;
use crate::Nanos;
use crate::guarantee::Guarantee;
use replenish_sim::Releases;
use sporadic::{Low, Params, Policy};
use toml::Spanned;

impl Parser<'_> {
    pub(super) fn guarantee(&self, at: &Spanned<schema::Guarantee>) -> Found<Guarantee> {
        let written = at.get_ref();
        let time = |t: &Option<Spanned<Time>>| t.as_ref().map(|t| t.get_ref().0);
        let (amount, period, per_job) = match (
            &written.budget,
            &written.period,
            &written.rate,
            &written.takes,
        ) {
            (Some(budget), Some(period), None, None) => {
                (budget.get_ref().0, period.get_ref().0, false)
            }
            (None, None, Some(rate), Some(takes)) => (takes.get_ref().0, rate.get_ref().0, true),
            _ => {
                let allowed = "a guarantee is either { budget, period } or { rate, takes }";
                return self.wrong(at, allowed);
            }
        };
        let mut guarantee = Guarantee {
            deadline: time(&written.deadline),
            importance: written
                .importance
                .as_ref()
                .map_or(Guarantee::IMPORTANCE, |i| *i.get_ref()),
            minimum: time(&written.minimum),
            desired: time(&written.desired),
            ..Guarantee::new(amount, period, per_job)
        };
        guarantee.budget.suspend = written.suspend;
        let Err(error) = guarantee.check() else {
            return Ok(guarantee);
        };
        let field = match error.field {
            "period" => written.period.as_ref(),
            "deadline" => written.deadline.as_ref(),
            "minimum" => written.minimum.as_ref(),
            "desired" => written.desired.as_ref(),
            _ => written.budget.as_ref().or(written.takes.as_ref()),
        };
        let place = field.map_or(at.span(), Spanned::span);
        Err(self.source.error(&place, error.in_file()))
    }

    pub(super) fn policy(&self, at: &Spanned<schema::Policy>, machine: &Machine) -> Found<Policy> {
        let written = at.get_ref();
        let kind = written.kind;
        let fields = [
            (
                "priority",
                written.priority.as_ref().map(Spanned::span),
                &[Kind::Fifo, Kind::Sporadic][..],
                true,
            ),
            (
                "background",
                written.background.as_ref().map(Spanned::span),
                &[Kind::Sporadic],
                false,
            ),
            (
                "suspend",
                written.suspend.as_ref().map(Spanned::span),
                &[Kind::Sporadic],
                false,
            ),
            (
                "budget",
                written.budget.as_ref().map(Spanned::span),
                &[Kind::Sporadic],
                true,
            ),
            (
                "period",
                written.period.as_ref().map(Spanned::span),
                &[Kind::Sporadic, Kind::Deadline],
                true,
            ),
            (
                "max_repl",
                written.max_repl.as_ref().map(Spanned::span),
                &[Kind::Sporadic],
                false,
            ),
            (
                "runtime",
                written.runtime.as_ref().map(Spanned::span),
                &[Kind::Deadline],
                true,
            ),
            (
                "deadline",
                written.deadline.as_ref().map(Spanned::span),
                &[Kind::Deadline],
                true,
            ),
        ];
        for (name, place, kinds, needed) in fields {
            match place {
                Some(place) if !kinds.contains(&kind) => {
                    let message = format!("a policy of kind {:?} has no {name}", kind.name());
                    return Err(self.source.error(&place, message));
                }
                None if needed && kinds.contains(&kind) => {
                    let message = format!("a policy of kind {:?} needs {name}", kind.name());
                    return self.wrong(at, message);
                }
                _ => {}
            }
        }
        let time = |t: &Option<Spanned<Time>>| t.as_ref().map_or(0, |t| t.get_ref().0);
        let priority = written.priority.as_ref().map_or(0, |p| *p.get_ref());
        if let Some(given) = &written.priority {
            let most = if kind == Kind::Sporadic {
                machine.enforcer_priority - 1
            } else {
                99
            };
            if !(1..=most).contains(&priority) {
                return self.wrong(given, format!("allowed 1 to {most}"));
            }
        }
        match kind {
            Kind::TimeShared => Ok(Policy::Other),
            Kind::Fifo => Ok(Policy::Fifo { priority }),
            Kind::Sporadic => {
                let suspend = written.suspend.as_ref().is_some_and(|s| *s.get_ref());
                let low = match &written.background {
                    Some(background) if suspend => {
                        let message = "either background or suspend = true, not both";
                        return self.wrong(background, message);
                    }
                    Some(background) => Low::Background(*background.get_ref()),
                    None if suspend => Low::Suspend,
                    None => Low::Background(0),
                };
                let repl = written.max_repl.as_ref().map_or(16, |n| *n.get_ref());
                if let Some(given) = written
                    .max_repl
                    .as_ref()
                    .filter(|_| !(2..=128).contains(&repl))
                {
                    let message = "allowed 2 to 128: with one pending replenishment each callback \
                                   puts all of the budget off";
                    return self.wrong(given, message);
                }
                match Params::new(
                    priority,
                    low,
                    time(&written.budget),
                    time(&written.period),
                    repl,
                ) {
                    Ok(params) => Ok(Policy::Sporadic(params)),
                    Err(error) => self.wrong(at, error.to_string()),
                }
            }
            Kind::Deadline => {
                let (runtime, deadline, period) = (
                    time(&written.runtime),
                    time(&written.deadline),
                    time(&written.period),
                );
                if !(1024 <= runtime && runtime <= deadline && deadline <= period) {
                    let allowed = "allowed is 1024 ns <= runtime <= deadline <= period";
                    return self.wrong(at, allowed);
                }
                Ok(Policy::Deadline {
                    runtime,
                    deadline,
                    period,
                    reclaim: false,
                })
            }
        }
    }

    pub(super) fn releases(&self, at: &Spanned<schema::Releases>) -> Found<Releases> {
        let written = at.get_ref();
        let time = |t: &Option<Spanned<Time>>| t.as_ref().map_or(0, |t| t.get_ref().0);
        let (offset, jitter, spacing) = (
            time(&written.offset),
            time(&written.jitter),
            time(&written.spacing),
        );
        let other = "allowed are { every, offset?, jitter? }, { every, burst, spacing, offset? }, { gap, offset? } or { at }";
        match (&written.every, &written.gap, &written.at, &written.burst) {
            (Some(every), None, None, None) if written.spacing.is_none() => {
                let period = self.positive(every)?;
                Ok(Releases::Periodic {
                    offset,
                    period,
                    jitter,
                })
            }
            (Some(every), None, None, Some(burst)) if written.jitter.is_none() => {
                let (period, count) = (self.positive(every)?, *burst.get_ref());
                if count == 0 || spacing.saturating_mul(Nanos::from(count)) > period {
                    let allowed = "allowed is a burst of at least 1 that ends before the next begins: burst * spacing <= every";
                    return self.wrong(burst, allowed);
                }
                Ok(Releases::Bursty {
                    offset,
                    period,
                    burst: count,
                    spacing,
                })
            }
            (None, Some(gap), None, None)
                if written.jitter.is_none() && written.spacing.is_none() =>
            {
                let gap = gap.get_ref().0.clone();
                Ok(Releases::Sporadic { offset, gap })
            }
            (None, None, Some(times), None)
                if written.offset.is_none() && written.jitter.is_none() =>
            {
                let list: Vec<Nanos> = times.get_ref().iter().map(|t| t.0).collect();
                if !list.is_sorted() {
                    return self.wrong(times, "allowed are times in ascending order");
                }
                Ok(Releases::At(list))
            }
            _ => self.wrong(at, other),
        }
    }

    fn positive(&self, time: &Spanned<Time>) -> Found<Nanos> {
        match time.get_ref().0 {
            0 => self.wrong(time, "0 is out of range: allowed 1 ns or more"),
            period => Ok(period),
        }
    }
}
