//! Is a system one that can be simulated? Says what is wrong, and where.

use crate::engine::CAPACITY;
use crate::{Nanos, Policy, Releases, Step, System, Thread};
use core::fmt;
use sporadic::Params;

/// Releases of a thread in a run, at most: its memory and its length grow with their number.
pub const MAX_RELEASES: u64 = 10_000_000;

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

    /// Checks that a run until `horizon` is not too long to be simulated.
    ///
    /// # Errors
    /// The first thread that is released more often than [`MAX_RELEASES`] times, and the field.
    pub fn check_until(&self, horizon: Nanos) -> Result<(), SpecError> {
        for thread in &self.threads {
            let count = thread.releases.count_until(horizon);
            if count > MAX_RELEASES {
                return Err(SpecError {
                    thread: Some(thread.name.clone()),
                    message: format!(
                        "{} gives {count} releases in {} s: allowed are {MAX_RELEASES} in a run",
                        thread.releases.field(),
                        horizon as f64 / 1e9
                    ),
                });
            }
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

impl Releases {
    /// Releases before `horizon`; of random ones, those to be expected.
    fn count_until(&self, horizon: Nanos) -> u64 {
        let rest = |offset: &Nanos| horizon.saturating_sub(*offset);
        match self {
            Self::Never => 0,
            Self::Periodic { offset, period, .. } => rest(offset).div_ceil((*period).max(1)),
            Self::Sporadic { offset, gap } => rest(offset).div_ceil(gap.mean().max(1)),
            Self::Bursty {
                offset,
                period,
                burst,
                spacing,
            } => {
                let (rest, period) = (rest(offset), (*period).max(1));
                let burst = u64::from(*burst);
                let last = match (rest % period, *spacing) {
                    (0, _) => 0,
                    (_, 0) => burst,
                    (part, spacing) => part.div_ceil(spacing).min(burst),
                };
                (rest / period).saturating_mul(burst).saturating_add(last)
            }
            Self::At(times) => times.partition_point(|time| *time < horizon) as u64,
        }
    }

    /// The field that says how many there are, as it and its value stand in a deployment file.
    fn field(&self) -> String {
        match self {
            Self::Never => "sends".into(),
            Self::Periodic { period, .. } => format!("every = \"{period} ns\""),
            Self::Sporadic { gap, .. } => format!("gap, {} ns on average,", gap.mean()),
            Self::Bursty { period, burst, .. } => {
                format!("burst = {burst} every {period} ns")
            }
            Self::At(_) => "at".into(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Options, Outcome, Span, simulate};

    fn system(releases: Releases) -> System {
        let policy = Policy::Fifo { priority: 1 };
        let thread = Thread::new("fast", policy).runs(0).released(releases);
        System::on_one_cpu(vec![thread])
    }

    fn run(releases: Releases, horizon: Nanos) -> Outcome {
        simulate(&system(releases), &Options::until(horizon)).unwrap()
    }

    #[test]
    fn releases_are_counted_as_they_come() {
        let bursty = |offset, period, burst, spacing| Releases::Bursty {
            offset,
            period,
            burst,
            spacing,
        };
        let all = [
            Releases::Never,
            Releases::periodic(7),
            Releases::Periodic {
                offset: 30,
                period: 10,
                jitter: 0,
            },
            Releases::Sporadic {
                offset: 3,
                gap: Span::Constant(9),
            },
            bursty(0, 50, 5, 10),
            bursty(7, 50, 4, 3),
            bursty(7, 50, 4, 0),
            Releases::At(vec![1, 2, 2, 99, 100, 200]),
        ];
        for releases in all {
            for horizon in [1, 7, 10, 57, 60, 63, 100, 1000] {
                let count = releases.count_until(horizon);
                let outcome = run(releases.clone(), horizon);
                assert_eq!(outcome.threads[0].released, count, "{releases:?} {horizon}");
            }
        }
    }

    #[test]
    fn a_run_that_would_take_hours_is_refused() {
        let second = 1_000_000_000;
        let burst = Releases::Bursty {
            offset: 0,
            period: second / 100,
            burst: u32::MAX,
            spacing: 0,
        };
        let gap = Span::Uniform { min: 0, max: 100 };
        let sporadic = Releases::Sporadic { offset: 0, gap };
        let cases = [
            (Releases::periodic(10), "every = \"10 ns\" gives 1000000000"),
            (burst, "burst = 4294967295 every 10000000 ns gives"),
            (sporadic, "gap, 50 ns on average, gives 200000000"),
        ];
        for (releases, expected) in cases {
            let error = simulate(&system(releases), &Options::until(10 * second)).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with("thread \"fast\": "), "{text}");
            assert!(text.contains(expected), "{text}");
            assert!(text.contains("allowed are 10000000 in a run"), "{text}");
        }
        system(Releases::periodic(1_000))
            .check_until(10 * second)
            .unwrap();
    }
}
