//! Threads that others have started, in admission: each pattern is a worker to the plan.

use crate::error::Error;
use crate::executor::run::guarantee::adoption::Adopted;
use alloc::format;
use alloc::string::String;
use replenish_plan::{Guarantee, Plan, Worker};

/// The longest pattern; names have 15 bytes.
const LONGEST: usize = 64;

/// Checks what was asked for, field by field.
pub(super) fn check(adopted: &[Adopted]) -> Result<(), Error> {
    for (place, asked) in adopted.iter().enumerate() {
        let owner = format!("adopt {:?}", asked.pattern);
        let wrong = |field, value: &str, allowed: &str| {
            Err(Error::Parameter {
                owner: owner.clone(),
                field,
                value: value.into(),
                allowed: allowed.into(),
            })
        };
        if asked.pattern.is_empty() || asked.pattern.len() > LONGEST {
            return wrong("pattern", &asked.pattern, "1 to 64 bytes");
        }
        let mut before = adopted.iter().take(place);
        if before.any(|other| other.pattern == asked.pattern) {
            return wrong("pattern", &asked.pattern, "each pattern once");
        }
        if asked.budget.suspend {
            let allowed = "a budget with a background: a foreign thread could hold a lock";
            return wrong("budget", "suspend", allowed);
        }
        if let Err(e) = Guarantee::from(asked.budget).check() {
            return wrong("budget", &format!("{}", asked.budget), &e.to_string());
        }
    }
    Ok(())
}

fn name(asked: &Adopted) -> String {
    format!("adopt {}", asked.pattern)
}

/// The workers that the plan is asked to place: one for each pattern.
pub(super) fn workers(adopted: &[Adopted]) -> impl Iterator<Item = Worker> {
    let worker = |asked: &Adopted| Worker::guaranteed(name(asked), asked.budget.into());
    adopted.iter().map(worker)
}

/// Takes the plan's priorities and CPUs.
pub(super) fn apply(plan: &Plan, adopted: &mut [Adopted]) {
    for asked in adopted {
        let name = name(asked);
        if let Some(planned) = plan.workers.iter().find(|worker| worker.name == name) {
            asked.place = Some((planned.priority(), planned.cpu));
        }
    }
}
