//! The reasons for each choice: the last column of the table.

use super::neighbours::percent;
use super::placement::ThreadPlan;
use super::plan::PlannedWorker;
use crate::span::{Exact, Rounded};
use crate::{Guarantee, Machine, Nanos, Requirement, Worker};
use sporadic::Policy;
use sporadic::{Low, Params};

/// A worker before anything was chosen for it.
pub(super) fn given(worker: &Worker) -> PlannedWorker {
    let policy = match &worker.scheduling {
        Requirement::Policy(policy) => *policy,
        Requirement::Guarantee(_) => Policy::Other,
    };
    PlannedWorker {
        name: worker.name.clone(),
        cpu: worker.cpu,
        policy,
        amount: None,
        deadline: worker.deadline,
        worst_response: None,
        reasons: vec!["policy given".into()],
    }
}

/// A guaranteed worker.
pub(super) fn worker(
    seat: &ThreadPlan,
    asked: Option<&Guarantee>,
    granted: Nanos,
    params: &Params,
    machine: &Machine,
    share: f64,
) -> Vec<String> {
    let mut reasons = vec![format!(
        "priority {}: deadline {}, the earlier the higher",
        params.priority(),
        Exact(seat.deadline)
    )];
    if seat.per_job {
        reasons.push(format!(
            "budget {}: {} for the callback, the rest for switching and enforcing; back {} before the next",
            Rounded(params.budget()),
            Exact(granted),
            Rounded(seat.period.saturating_sub(params.period()))
        ));
    } else if let Some(asked) = asked.filter(|a| a.desired() > a.minimum()) {
        reasons.push(format!(
            "budget {}: between its minimum {} and its desired {}, by importance {}",
            Exact(granted),
            Exact(asked.minimum()),
            Exact(asked.desired()),
            seat.importance
        ));
    } else {
        reasons.push("budget as asked for".into());
    }
    reasons.push(match params.low() {
        Low::Suspend => "waits without budget: asked for".into(),
        Low::Background(0) => format!(
            "time-shared without budget: the kernel stops real-time threads that take more than {:.0} % of a CPU",
            machine.real_time_share * 100.0
        ),
        Low::Background(low) => {
            format!("background {low}: importance {}, below all budgets", seat.importance)
        }
    });
    reasons.push(match seat.cpu {
        Some(cpu) => format!("CPU {cpu}: asked for"),
        None if machine.cpus.len() == 1 => "the only CPU".into(),
        None if seat.together.is_some() => "this CPU: room for all that share its groups".into(),
        None => format!("this CPU: room for it, {} reserved now", percent(share)),
    });
    reasons.push(if seat.per_job {
        format!(
            "{} replenishments: one callback per period",
            params.max_repl()
        )
    } else {
        format!(
            "{} replenishments: so many pieces per period, more would make the bound worse",
            params.max_repl()
        )
    });
    reasons
}

/// The wait for a lock that another worker may hold.
pub(super) fn waits(lock: &str, length: Nanos, whose: &str) -> String {
    format!(
        "group {lock:?}: waits up to {} for {whose}",
        Rounded(length)
    )
}

/// The executor.
pub(super) fn executor(seat: &ThreadPlan) -> Vec<String> {
    vec![
        "above all workers: messages reach them at once".into(),
        format!(
            "5 % every {}, so that a flood of messages takes no more; at most the shortest deadline apart",
            Exact(seat.period)
        ),
    ]
}

/// A thread that may take all that is left.
pub(super) fn unlimited(name: &str, cpu: usize, reach: &str) -> String {
    format!(
        "{name} may take CPU {cpu} without limit {reach} others: where real-time threads take a whole CPU, \
         the kernel stops all of them for a while in every second, guarantees included"
    )
}
