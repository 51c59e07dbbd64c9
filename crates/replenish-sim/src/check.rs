//! Is a system one that can be simulated? Says what is wrong, and where.

use crate::engine::CAPACITY;
use crate::{Policy, Releases, Step, System, Thread};
use core::fmt;
use sporadic::Params;

/// A contradiction in a [`System`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SpecError {
    /// The thread, if it is about one.
    pub thread: Option<String>,
    /// The field and the allowed range.
    pub message: String,
}

impl fmt::Display for SpecError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.thread {
            Some(name) => write!(f, "thread \"{name}\": {}", self.message),
            None => f.write_str(&self.message),
        }
    }
}

impl core::error::Error for SpecError {}

impl System {
    /// Checks every field.
    ///
    /// # Errors
    /// The first field that is out of its range, with the range.
    pub fn check(&self) -> Result<(), SpecError> {
        if self.cpus == 0 {
            return Err(SpecError {
                thread: None,
                message: "cpus is 0: at least 1".into(),
            });
        }
        if self.platform.tick == Some(0) {
            return Err(SpecError {
                thread: None,
                message: "platform.tick is 0: at least 1 ns, or none".into(),
            });
        }
        for thread in &self.threads {
            self.check_thread(thread).map_err(|message| SpecError {
                thread: Some(thread.name.clone()),
                message,
            })?;
        }
        Ok(())
    }

    fn check_thread(&self, thread: &Thread) -> Result<(), String> {
        if let Some(cpu) = thread.cpu
            && cpu >= self.cpus
        {
            return Err(format!("cpu {cpu}: allowed 0 to {}", self.cpus - 1));
        }
        check_policy(&thread.policy)?;
        check_releases(&thread.releases)?;
        self.check_body(&thread.body)
    }

    fn check_body(&self, body: &[Step]) -> Result<(), String> {
        let mut held = vec![false; self.locks];
        for (at, step) in body.iter().enumerate() {
            match *step {
                Step::Run(_) | Step::Block(_) => {}
                Step::Send(to) if to < self.threads.len() => {}
                Step::Send(to) => return Err(format!("step {at} sends to thread {to}: none such")),
                Step::Lock(lock) | Step::Unlock(lock) if lock >= self.locks => {
                    return Err(format!("step {at} uses lock {lock}: none such"));
                }
                Step::Lock(lock) if held[lock] => {
                    return Err(format!("step {at} takes lock {lock}, which it holds"));
                }
                Step::Unlock(lock) if !held[lock] => {
                    return Err(format!("step {at} releases lock {lock}, which it lacks"));
                }
                Step::Lock(lock) => held[lock] = true,
                Step::Unlock(lock) => held[lock] = false,
            }
        }
        match held.iter().position(|&held| held) {
            Some(lock) => Err(format!("the body ends with lock {lock} held")),
            None => Ok(()),
        }
    }
}

fn check_policy(policy: &Policy) -> Result<(), String> {
    if policy.priority() == Some(0) {
        return Err("priority is 0: allowed 1 to 255".into());
    }
    if let Some(repl) = policy.params().map(Params::max_repl)
        && usize::from(repl) > CAPACITY
    {
        return Err(format!("max_repl is {repl}: allowed 1 to {CAPACITY}"));
    }
    match *policy {
        Policy::Deadline {
            runtime,
            deadline,
            period,
            ..
        } if !(0 < runtime && runtime <= deadline && deadline <= period) => Err(format!(
            "runtime {runtime}, deadline {deadline}, period {period}: \
             must be 0 < runtime <= deadline <= period"
        )),
        _ => Ok(()),
    }
}

fn check_releases(releases: &Releases) -> Result<(), String> {
    match releases {
        Releases::Periodic { period: 0, .. } | Releases::Bursty { period: 0, .. } => {
            Err("period is 0: at least 1 ns".into())
        }
        Releases::Bursty { burst: 0, .. } => Err("burst is 0: at least 1".into()),
        Releases::Bursty {
            period,
            burst,
            spacing,
            ..
        } if spacing.saturating_mul(u64::from(*burst)) > *period => Err(format!(
            "a burst of {burst} releases {spacing} ns apart is longer than the period {period}"
        )),
        Releases::At(times) if !times.is_sorted() => {
            Err("release times are not in ascending order".into())
        }
        _ => Ok(()),
    }
}
