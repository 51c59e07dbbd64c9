//! Plans one scheduling policy per thread from the users' requests. Pure; run when the executor
//! starts.
//!
//! | policy | budget | result |
//! |---|---|---|
//! | none | none | time sharing (`SCHED_OTHER`) |
//! | any | none | that policy |
//! | none | B every T | sporadic; priority 60 for the shortest T, one less for each longer T |
//! | FIFO p | B every T | sporadic at priority p |
//!
//! A budget's background priority is 6 (the paper's), or p - 1 where p is 6 or less.

use crate::Nanos;
use crate::error::Error;
use crate::executor::run::request::WorkerRequest;
use crate::executor::run::state::WorkerSpec;
use crate::platform::{BARE, STD, Static, Text, text};
use core::ops::RangeInclusive;
use replenish_os::{MAX_REPL, ParamError, Params, Policy};
use sporadic::Budget;
use sporadic::priority::by_rank;

/// Budgeted workers without a policy get these, the shortest period the highest.
const PRIORITIES: RangeInclusive<u8> = 20..=60;
/// Priority of budgeted workers whose budget is used up.
const BACKGROUND: u8 = 6;
/// The dispatcher's FIFO priority as soon as any worker is real-time.
const DISPATCHER: u8 = 98;
/// The smallest accepted stack, in bytes: what glibc accepts, or one frame and the registers.
/// registers need.
const MIN_STACK: usize = if STD { 16 * 1024 } else { 512 };

/// Writes down the policy of each worker, and the dispatcher's where none is given. The requests
/// have been [checked](check).
#[inline(never)]
pub(crate) fn plan(
    workers: &mut [Static<WorkerSpec>],
    dispatcher: &mut Option<Policy>,
    enforcer_priority: u8,
) -> Result<(), Error> {
    if !(2..=99).contains(&enforcer_priority) {
        let field = "enforcer_priority";
        return Err(Error::parameter(
            "executor",
            field,
            &enforcer_priority,
            "2..=99",
        ));
    }
    let (mut highest, mut budgeted) = (0, false);
    for at in 0..workers.len() {
        let period = workers.get(at).map_or(0, |w| wished(&w.request));
        let steps = shorter(period, workers);
        let Some(w) = workers.get_mut(at) else {
            break;
        };
        w.policy = policy(&w.request, steps)?;
        highest = rank(&w.policy).max(highest);
        budgeted |= matches!(w.policy, Policy::Sporadic(_));
    }
    let dispatcher = dispatcher.get_or_insert(match highest {
        0 => Policy::Other,
        _ => Policy::Fifo {
            priority: DISPATCHER.min(enforcer_priority - 1),
        },
    });
    if budgeted || matches!(dispatcher, Policy::Sporadic(_)) {
        for w in workers.iter() {
            below_enforcer(|| w.request.owner(), &w.policy, enforcer_priority)?;
        }
        below_enforcer(|| "dispatcher".into(), dispatcher, enforcer_priority)?;
    }
    Ok(())
}

/// The highest [`rank`].
pub(crate) const URGENT: u16 = 256;

/// Urgency of a policy: workers are woken in this order. 0 is time sharing.
#[inline(never)]
pub(crate) fn rank(policy: &Policy) -> u16 {
    match policy {
        Policy::Other => 0,
        Policy::Fifo { priority } | Policy::RoundRobin { priority } => u16::from(*priority),
        Policy::Sporadic(params) | Policy::KernelSporadic(params) => u16::from(params.priority()),
        Policy::Deadline { .. } => URGENT,
    }
}

pub(crate) fn check(w: &WorkerRequest) -> Result<(), Error> {
    crate::name::worker(&w.name)?;
    if let Some(bytes) = w.stack_size.filter(|s| *s < MIN_STACK) {
        let allowed = text!("{MIN_STACK} bytes or more");
        return Err(Error::parameter(w.owner(), "stack_size", &bytes, allowed));
    }
    if let (Some(policy), Some(guarantee)) = (&w.policy, &w.guarantee) {
        let allowed = text!("none beside the policy {policy}: it is one or the other");
        return Err(Error::parameter(w.owner(), "guarantee", guarantee, allowed));
    }
    if let (Some(policy @ Policy::KernelSporadic(_)), false) =
        (&w.policy, cfg!(target_os = "nuttx"))
    {
        let allowed = "a policy of this system: SCHED_SPORADIC is NuttX's";
        return Err(Error::parameter(w.owner(), "policy", policy, allowed));
    }
    if let Some(Policy::Sporadic(params)) = &w.policy
        && params.max_repl() < 2
        && !BARE
    {
        let allowed = text!(
            "2 to {MAX_REPL}: with one pending replenishment each callback puts all of the budget \
             off, until nothing is there for a period"
        );
        return Err(Error::parameter(
            w.owner(),
            "max_repl",
            &params.max_repl(),
            allowed,
        ));
    }
    if let (Some(Policy::Deadline { .. }), Some(cpu)) = (&w.policy, w.cpu) {
        let allowed = "none: SCHED_DEADLINE threads cannot be pinned";
        return Err(Error::parameter(w.owner(), "cpu", &cpu, allowed));
    }
    Ok(())
}

/// `steps`: how many periods are shorter than its own.
fn policy(w: &WorkerRequest, steps: u8) -> Result<Policy, Error> {
    // Guarantees get here only where admission is turned off.
    let Some(budget) = w.budget.or(w.guarantee.map(|g| g.budget())) else {
        return Ok(w.policy.unwrap_or(Policy::Other));
    };
    let priority = match &w.policy {
        Some(Policy::Fifo { priority }) => *priority,
        Some(other) => {
            let allowed = text!("no budget beside {other}: give a FIFO policy or none");
            return Err(Error::parameter(w.owner(), "budget", &budget, allowed));
        }
        None => by_rank(&PRIORITIES, steps.into(), usize::from(steps) + 1),
    };
    let Some(policy) = sporadic(&budget, priority) else {
        let allowed = "2..=98: the background priority needs room below it";
        return Err(Error::parameter(
            w.owner(),
            "policy.priority",
            &priority,
            allowed,
        ));
    };
    policy.map_err(|e| Error::parameter(w.owner(), "budget", &budget, text!("{e}")))
}

/// The sporadic server of a budget at `priority`; `None`: there is no room for its background.
pub(crate) fn sporadic(budget: &Budget, priority: u8) -> Option<Result<Policy, ParamError>> {
    let low = budget.low(priority, BACKGROUND)?;
    let max_repl = u16::try_from(MAX_REPL).unwrap_or(u16::MAX);
    let params = Params::new(priority, low, budget.amount, budget.period, max_repl);
    Some(params.map(Policy::Sporadic))
}

/// Number of different periods below this one among the budgets of workers without a policy.
/// Neither sorts nor collects: both bring code for which small images have no room.
fn shorter(mut period: Nanos, workers: &[Static<WorkerSpec>]) -> u8 {
    let mut count = 0_u8;
    loop {
        // Down from one to the next shorter, until there is none.
        let mut next = 0;
        for w in workers {
            let its = wished(&w.request);
            if its < period {
                next = its.max(next);
            }
        }
        if next == 0 {
            return count;
        }
        period = next;
        count = count.saturating_add(1);
    }
}

/// The period whose rank is the priority of a worker that has none; 0 if it has one or needs none.
#[inline(never)]
fn wished(w: &WorkerRequest) -> Nanos {
    match (w.policy, w.budget) {
        (None, Some(budget)) => budget.period,
        _ => 0,
    }
}

fn below_enforcer(
    owner: impl FnOnce() -> Text,
    policy: &Policy,
    enforcer: u8,
) -> Result<(), Error> {
    let rank = rank(policy);
    if rank < u16::from(enforcer) || rank > 99 {
        return Ok(());
    }
    let allowed = text!("1..={}: below the enforcer", enforcer - 1);
    Err(Error::parameter(owner(), "policy.priority", &rank, allowed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::time::Duration;
    use replenish_os::Low;

    fn ms(n: u64) -> Duration {
        Duration::from_millis(n)
    }

    fn request(name: &str, policy: Option<Policy>, budget: Option<Budget>) -> WorkerRequest {
        WorkerRequest {
            policy,
            budget,
            ..WorkerRequest::named(name)
        }
    }

    /// The workers' policies, and the dispatcher's.
    fn plan_all(requests: &[WorkerRequest]) -> Result<(Vec<Policy>, Policy), Error> {
        requests.iter().try_for_each(check)?;
        let spec = |request: &WorkerRequest| WorkerSpec {
            request: request.clone(),
            ..WorkerSpec::new("")
        };
        let mut workers: Vec<_> = requests.iter().map(spec).collect();
        let mut dispatcher = None;
        plan(&mut workers, &mut dispatcher, 99)?;
        let workers = workers.iter().map(|w| w.policy);
        Ok((workers.collect(), dispatcher.unwrap_or_default()))
    }

    fn planned(requests: &[WorkerRequest]) -> Result<Vec<Policy>, Error> {
        plan_all(requests).map(|(workers, _)| workers)
    }

    fn sporadic(policy: &Policy) -> Params {
        match policy {
            Policy::Sporadic(p) => *p,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn shorter_periods_get_higher_priorities_and_equal_ones_the_same() {
        let budget = |period| Some(Budget::of(ms(1)).every(ms(period)));
        let names = [("a", 100), ("b", 10), ("c", 100), ("d", 20)];
        let all: Vec<_> = names.map(|(n, p)| request(n, None, budget(p))).into();
        let got = planned(&all).unwrap();
        let priorities: Vec<_> = got.iter().map(|p| sporadic(p).priority()).collect();
        assert_eq!(priorities, [58, 60, 58, 59]);
        assert!(got.iter().all(|p| sporadic(p).low() == Low::Background(6)));
    }

    #[test]
    fn a_budget_beside_fifo_keeps_the_priority() {
        let fifo = |p| Some(Policy::fifo(p).unwrap());
        let budget = Some(Budget::of(ms(30)).every(ms(100)));
        let got = planned(&[
            request("a", fifo(50), budget),
            request("b", fifo(3), budget),
            request("c", fifo(3), budget.map(Budget::suspend)),
        ])
        .unwrap();
        let all: Vec<_> = got.iter().map(sporadic).collect();
        assert_eq!((all[0].priority(), all[0].low()), (50, Low::Background(6)));
        assert_eq!((all[1].priority(), all[1].low()), (3, Low::Background(2)));
        assert_eq!((all[2].priority(), all[2].low()), (3, Low::Suspend));
        assert_eq!(
            (all[0].budget(), all[0].period()),
            (30_000_000, 100_000_000)
        );
    }

    #[test]
    fn the_dispatcher_is_real_time_iff_a_worker_is() {
        let plain = request("a", None, None);
        let fifo = request("b", Some(Policy::fifo(10).unwrap()), None);
        assert_eq!(
            plan_all(core::slice::from_ref(&plain)).unwrap().1,
            Policy::Other
        );
        let dispatcher = plan_all(&[plain, fifo]).unwrap().1;
        assert_eq!(dispatcher, Policy::fifo(98).unwrap());
    }

    #[test]
    fn bad_requests_name_the_worker_the_field_and_the_range() {
        let says = |r: WorkerRequest| planned(&[r]).unwrap_err().to_string();
        let budget = |b, t| Some(Budget::of(ms(b)).every(ms(t)));
        let over = says(request("w", None, budget(20, 10)));
        assert!(
            over.starts_with("worker \"w\": budget = 20 ms every 10 ms is not allowed"),
            "{over}"
        );
        assert!(says(request("w", None, budget(0, 10))).contains("budget"));
        assert!(says(request("w", None, budget(0, 0))).contains("budget"));
        let both = says(request("w", Some(Policy::Other), budget(1, 10)));
        assert!(both.contains("no budget beside"), "{both}");
        let high = says(request("w", Some(Policy::fifo(99).unwrap()), budget(1, 10)));
        assert!(
            high.contains("policy.priority = 99 is not allowed: 1..=98"),
            "{high}"
        );
        let low = says(request("w", Some(Policy::fifo(1).unwrap()), budget(1, 10)));
        assert!(
            low.contains("policy.priority = 1 is not allowed: 2..=98"),
            "{low}"
        );
        let stack = WorkerRequest {
            stack_size: Some(100),
            ..request("w", None, None)
        };
        assert!(says(stack).contains("stack_size = 100"));
    }
}
