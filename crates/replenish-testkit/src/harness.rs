//! Trials that can be skipped at run time and are then counted as ignored.
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

use crate::{rt, steal};
use libtest_mimic::{Arguments, Failed, Trial};

/// A trial that runs everywhere; it fails when `body` panics.
pub fn trial(name: &str, body: impl FnOnce() + Send + 'static) -> Trial {
    Trial::test(name, move || {
        body();
        Ok(())
    })
}

/// A trial that needs real-time priority: it takes the machine-wide lock, and where the priority
/// is missing it counts as ignored, unless [`rt::REQUIRE`] is set. A failure while a hypervisor took
/// CPU time away says nothing, and `body` runs again ([`steal::undisturbed`]).
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
    let missing = rt::available().err();
    let skip = missing.is_some() && !rt::required();
    if let (true, Some(why)) = (skip, &missing) {
        eprintln!("skipped: {name}: {why}");
    }
    Trial::test(name, move || match missing {
        Some(why) => Err(format!("{why}, and {} forbids skipping", rt::REQUIRE).into()),
        None => body(),
    })
    .with_ignored_flag(skip)
}

/// Set to `1`, it makes trials that lack a foreign peer fail instead of being ignored.
pub const REQUIRE_PEERS: &str = "REPLENISH_REQUIRE_PEERS";

/// A trial that needs a foreign program, of which `missing` says what is not here and how to get
/// it: then it counts as ignored, unless [`REQUIRE_PEERS`] is set.
pub fn peer_trial(
    name: &str,
    missing: Option<String>,
    body: impl FnOnce() + Send + 'static,
) -> Trial {
    let required = std::env::var_os(REQUIRE_PEERS).is_some_and(|value| value == "1");
    let skip = missing.is_some() && !required;
    if let (true, Some(why)) = (skip, &missing) {
        eprintln!("skipped: {name}: {why}");
    }
    Trial::test(name, move || match missing {
        Some(why) => Err(format!("{why}, and {REQUIRE_PEERS} forbids skipping").into()),
        None => {
            body();
            Ok(())
        }
    })
    .with_ignored_flag(skip)
}

/// Runs the trials with the usual `cargo test` arguments and exits.
pub fn run(trials: Vec<Trial>) -> ! {
    libtest_mimic::run(&Arguments::from_args(), trials).exit()
}
