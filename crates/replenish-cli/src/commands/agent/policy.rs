//! The scheduling policy of the agent's thread: the one that the command was started with, or the
//! one that `--policy` names.

use crate::outcome::Failure;
use replenish_os::{GrantedPolicy, Policy, SchedClass, current_tid, granted, set_priority};

/// Reads `other`, `fifo:N` or `rr:N`.
pub(super) fn parse(text: &str) -> Result<Policy, String> {
    let allowed =
        || format!("policy is {text}, allowed is other, fifo:1 to fifo:99, rr:1 to rr:99");
    if text == "other" {
        return Ok(Policy::Other);
    }
    let (kind, priority) = text.split_once(':').ok_or_else(allowed)?;
    let priority: u8 = priority.parse().map_err(|_| allowed())?;
    let policy = match kind {
        "fifo" => Policy::Fifo { priority },
        "rr" => Policy::RoundRobin { priority },
        _ => return Err(allowed()),
    };
    policy.validate().map_err(|_| allowed())
}

/// The policy that this thread was started with, which `chrt` and systemd set. This thread itself
/// becomes ordinary: it and its other children draw tables and write the log.
pub(super) fn take_over() -> Result<Policy, Failure> {
    let wrong = |e: std::io::Error| Failure::refused(format!("cannot read its own policy: {e}"));
    let this = current_tid();
    let had = granted(this).map_err(wrong)?;
    let priority = had.priority;
    let policy = match had.policy {
        GrantedPolicy::Fifo => Policy::Fifo { priority },
        GrantedPolicy::RoundRobin => Policy::RoundRobin { priority },
        GrantedPolicy::Deadline {
            runtime,
            deadline,
            period,
            reclaim,
        } => Policy::Deadline {
            runtime,
            deadline,
            period,
            reclaim,
        },
        // A nice value is inherited.
        _ => return Ok(Policy::Other),
    };
    set_priority(this, SchedClass::Other).map_err(wrong)?;
    Ok(policy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_by_name() {
        assert_eq!(parse("other"), Ok(Policy::Other));
        assert_eq!(parse("fifo:70"), Ok(Policy::Fifo { priority: 70 }));
        assert_eq!(parse("rr:1"), Ok(Policy::RoundRobin { priority: 1 }));
        for wrong in [
            "fifo",
            "fifo:0",
            "fifo:100",
            "rr:x",
            "fifo:-1",
            "FIFO:7",
            "deadline:3",
        ] {
            let error = parse(wrong).unwrap_err();
            assert!(
                error.contains(wrong) && error.contains("fifo:1 to fifo:99"),
                "{error}"
            );
        }
    }
}
