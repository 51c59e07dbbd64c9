//! A deployment file: read, planned, and laid over a program as an overlay.
#![no_main]

use libfuzzer_sys::fuzz_target;
use replenish::{Context, Every, Executor};
use replenish_plan::Deployment;
use std::time::Duration;

/// More workers, chains and releases make a plan long: they are not what is looked for here.
const SHORT: usize = 12;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = core::str::from_utf8(bytes) else {
        return;
    };
    match Deployment::parse(text, "fuzz") {
        Err(error) => assert!(!error.message.is_empty() && error.line <= text.lines().count() + 1),
        Ok(file) if file.workers.len() <= SHORT && file.chains.len() <= SHORT => {
            match file.plan() {
                Ok(plan) => file.system(&plan).check().unwrap(),
                Err(refusal) => assert!(!refusal.sentence.is_empty()),
            }
        }
        Ok(_) => return,
    }
    overlay(text);
});

/// The same file over a program with two workers.
fn overlay(text: &str) {
    let path = std::env::temp_dir().join(format!("replenish-fuzz-{}.toml", std::process::id()));
    std::fs::write(&path, text).unwrap();
    let context = Context::in_process();
    let mut executor = Executor::new(&context);
    for name in ["control", "map"] {
        let every = Every::period(Duration::from_secs(3600));
        executor.worker(name).timer(every, |_| ()).unwrap();
    }
    executor.overlay(&path);
    if let Err(error) = executor.local() {
        assert!(!error.to_string().is_empty());
    }
}
