//! Trials that can be skipped at run time and are then counted as ignored: beforehand, by the
//! reason given to [`Trial::skipped_if`], or from within, by [`skip`].
//!
//! A test target uses it with `harness = false`:
//!
//! ```no_run
//! use replenish_testkit::harness::{rt_trial, run, trial};
//! run(vec![
//!     trial("always", || assert_eq!(1 + 1, 2)),
//!     rt_trial("needs_fifo", || { /* runs alone on the machine */ }),
//! ]);
//! ```

pub use crate::skip::{REQUIRE_PEERS, skip, skip_peer, skip_rt};
use crate::skip::{Skipped, peers_required};
use crate::{rt, steal};
use libtest_mimic::{Arguments, Completion, Failed};
use std::panic::resume_unwind;

/// A name, a body, and the reason to skip it.
pub struct Trial {
    name: String,
    skip: bool,
    body: Box<dyn FnOnce() -> Result<(), Failed> + Send>,
}

impl Trial {
    fn new(name: &str, body: impl FnOnce() -> Result<(), Failed> + Send + 'static) -> Self {
        Self {
            name: name.to_string(),
            skip: false,
            body: Box::new(body),
        }
    }

    /// Counts as ignored if something is `missing`, and the log says it.
    #[must_use]
    pub fn skipped_if(mut self, missing: Option<&str>) -> Self {
        if let Some(why) = missing {
            eprintln!("skipped: {}: {why}", self.name);
            self.skip = true;
        }
        self
    }

    fn named(self, prefix: &str) -> libtest_mimic::Trial {
        let name = format!("{prefix}{}", self.name);
        // A thread of its own: a trial may change policy and CPU of its thread.
        let body = move || match std::thread::spawn(self.body).join() {
            Ok(result) => result.map(|()| Completion::Completed),
            Err(payload) => match payload.downcast::<Skipped>() {
                Ok(skipped) => Ok(Completion::ignored_with(skipped.0)),
                Err(payload) => resume_unwind(payload),
            },
        };
        libtest_mimic::Trial::ignorable_test(name, body).with_ignored_flag(self.skip)
    }
}

/// A trial that runs everywhere; it fails when `body` panics.
pub fn trial(name: &str, body: impl FnOnce() + Send + 'static) -> Trial {
    Trial::new(name, move || {
        body();
        Ok(())
    })
}

/// A trial that needs real-time priority and takes the machine-wide lock.
///
/// Without the priority it counts as ignored, unless [`rt::REQUIRE`] is set. A failure while a
/// hypervisor took CPU time away says nothing, and `body` runs again; after one that no clock
/// explains it must pass twice ([`steal::undisturbed`]).
pub fn rt_trial(name: &str, body: impl Fn() + Send + 'static) -> Trial {
    let this = name.to_string();
    needs_rt(name, move || {
        let _alone = rt::lock().map_err(|e| format!("real-time lock: {e}"))?;
        steal::undisturbed(&this, &body);
        Ok(())
    })
}

/// Like [`rt_trial`], for a body that runs a program which takes the lock itself.
pub fn rt_program_trial(name: &str, body: impl Fn() + Send + 'static) -> Trial {
    let this = name.to_string();
    needs_rt(name, move || {
        steal::undisturbed(&this, &body);
        Ok(())
    })
}

fn needs_rt(name: &str, body: impl FnOnce() -> Result<(), Failed> + Send + 'static) -> Trial {
    unless(
        name,
        rt::available().err(),
        rt::REQUIRE,
        rt::required(),
        body,
    )
}

/// A trial that lacks something counts as ignored, or fails if `variable` has `required` it.
fn unless(
    name: &str,
    missing: Option<String>,
    variable: &'static str,
    required: bool,
    body: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    let Some(why) = missing else {
        return Trial::new(name, body);
    };
    let refusal = format!("{why}, and {variable} forbids skipping");
    let trial = Trial::new(name, move || Err(refusal.into()));
    trial.skipped_if((!required).then_some(&why))
}

/// A trial that needs a foreign program. `missing` names it and the way to get it: then the trial
/// counts as ignored, unless [`REQUIRE_PEERS`] is set.
pub fn peer_trial(
    name: &str,
    missing: Option<String>,
    body: impl FnOnce() + Send + 'static,
) -> Trial {
    unless(name, missing, REQUIRE_PEERS, peers_required(), move || {
        body();
        Ok(())
    })
}

/// Runs the trials with the usual `cargo test` arguments and exits.
pub fn run(trials: Vec<Trial>) -> ! {
    let trials = trials.into_iter().map(|t| t.named("")).collect();
    libtest_mimic::run(&arguments(), trials).exit()
}

/// Runs the trials of several modules one after another, and exits. Names begin with the module's.
pub fn run_in_turn<const N: usize>(modules: [(&str, Vec<Trial>); N]) -> ! {
    let mut arguments = Arguments::from_args();
    arguments.test_threads = Some(1);
    libtest_mimic::run(&arguments, named(modules)).exit()
}

/// Runs the trials of several modules side by side, and exits. Names begin with the module's.
pub fn run_together<const N: usize>(modules: [(&str, Vec<Trial>); N]) -> ! {
    libtest_mimic::run(&arguments(), named(modules)).exit()
}

/// The arguments of the command line. Without a number of threads there, it is that of other tests
/// (`RUST_TEST_THREADS`).
fn arguments() -> Arguments {
    let mut arguments = Arguments::from_args();
    let everywhere = || std::env::var("RUST_TEST_THREADS").ok()?.parse().ok();
    arguments.test_threads = arguments.test_threads.or_else(everywhere);
    arguments
}

fn named<const N: usize>(modules: [(&str, Vec<Trial>); N]) -> Vec<libtest_mimic::Trial> {
    let named = |(module, trials): (&str, Vec<Trial>)| {
        let prefix = format!("{module}::");
        trials.into_iter().map(move |t| t.named(&prefix))
    };
    modules.into_iter().flat_map(named).collect()
}
