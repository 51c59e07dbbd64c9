//! A thread's scheduling and stack, read back from the system.

use super::task_slot;
use crate::Nanos;
use crate::Tid;
use crate::rtos::error::OsError;
use core::fmt;
use sporadic::WholeUnits;

/// The scheduling of a thread as the system reports it. Under an enforcer the priority is that of
/// the moment, a boost by inheritance included.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Granted {
    /// The scheduling class.
    pub policy: GrantedPolicy,
    /// The priority, 1 to 255.
    pub priority: u8,
    /// The stack in bytes; 0 for a thread that this crate did not make.
    pub stack_bytes: usize,
}

/// A scheduling class of this system.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum GrantedPolicy {
    /// Another class; on a host only.
    Other,
    /// `SCHED_FIFO`.
    Fifo,
    /// `SCHED_RR`.
    RoundRobin,
    /// `SCHED_SPORADIC`, in whole ticks of the system.
    Sporadic {
        /// The priority while the budget is used up.
        low: u8,
        /// CPU time at the high priority, in nanoseconds.
        budget: Nanos,
        /// In every period, in nanoseconds.
        period: Nanos,
        /// Pending replenishments at most.
        max_repl: u8,
    },
}

/// Reads what thread `tid` has.
///
/// # Errors
/// If no thread has this number, or with the system's answer.
pub fn granted(tid: Tid) -> Result<Granted, OsError> {
    let ended = OsError::new("no thread has this number");
    let slot = task_slot::find(tid.get()).ok_or(ended)?;
    let (how, stack_bytes) = slot.state.with(|s| {
        let how = if s.ended || s.task.is_none() {
            Err(ended)
        } else {
            slot.thread.policy()
        };
        (how, s.stack_bytes)
    });
    let how = how?;
    let small = |value: i32| u8::try_from(value).unwrap_or(u8::MAX);
    let policy = match how.kind {
        1 => GrantedPolicy::Fifo,
        2 => GrantedPolicy::RoundRobin,
        3 => GrantedPolicy::Sporadic {
            low: small(how.low),
            budget: how.budget,
            period: how.period,
            max_repl: small(how.max_repl),
        },
        _ => GrantedPolicy::Other,
    };
    Ok(Granted {
        policy,
        priority: small(how.priority),
        stack_bytes,
    })
}

/// `FIFO 60, stack 4096 B`; `SCHED_SPORADIC 60/6 (30 ms every 100 ms), stack 4096 B`.
impl fmt::Display for Granted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let priority = self.priority;
        match self.policy {
            GrantedPolicy::Other => f.write_str("OTHER")?,
            GrantedPolicy::Fifo => write!(f, "FIFO {priority}")?,
            GrantedPolicy::RoundRobin => write!(f, "RR {priority}")?,
            GrantedPolicy::Sporadic {
                low,
                budget,
                period,
                ..
            } => {
                let (budget, period) = (WholeUnits(budget), WholeUnits(period));
                write!(
                    f,
                    "SCHED_SPORADIC {priority}/{low} ({budget} every {period})"
                )?;
            }
        }
        write!(f, ", stack {} B", self.stack_bytes)
    }
}
