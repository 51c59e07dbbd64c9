//! One case: its threads, what they do for 10 s, and their end.

use crate::say;
use crate::work::burst;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use replenish_os::{
    Account, Enforcer, EnforcerConfig, Low, Meter, Notify, Params, PiMutex, Policy, Thread,
    ThreadSpec, Usage, clock, granted, spawn,
};
use sporadic::Kind;

const MS: u64 = 1_000_000;
const LENGTH: u64 = 10_000 * MS;
const PERIOD: u64 = 100 * MS;
const BACKGROUND: u8 = 6;

/// A thread of a case.
#[derive(Clone, Copy)]
pub(crate) struct Load {
    policy: Policy,
    offset: u64,
    endless: bool,
}

fn params(priority: u8, budget_ms: u64) -> Option<Params> {
    Params::new(
        priority,
        Low::Background(BACKGROUND),
        budget_ms * MS,
        PERIOD,
        10,
    )
    .ok()
}

impl Load {
    /// `budget_ms` per 100 ms at `priority`, by the enforcer.
    pub(crate) fn budget(priority: u8, budget_ms: u64) -> Self {
        Self::with(params(priority, budget_ms).map(Policy::Sporadic))
    }

    /// The same by the system.
    pub(crate) fn native(priority: u8, budget_ms: u64) -> Self {
        Self::with(params(priority, budget_ms).map(Policy::KernelSporadic))
    }

    /// No budget.
    pub(crate) fn fifo(priority: u8) -> Self {
        Self::with(Some(Policy::Fifo { priority }))
    }

    fn with(policy: Option<Policy>) -> Self {
        Self {
            policy: policy.unwrap_or_default(),
            offset: 0,
            endless: false,
        }
    }

    /// Starts it this many milliseconds after the case.
    pub(crate) fn after(self, offset_ms: u64) -> Self {
        Self {
            offset: offset_ms * MS,
            ..self
        }
    }

    /// Its first callback ends with the case only.
    pub(crate) fn endless(self) -> Self {
        Self {
            endless: true,
            ..self
        }
    }
}

#[derive(Default)]
struct Shared {
    bursts: AtomicU32,
    stop: AtomicBool,
    meter: PiMutex<Option<Meter>>,
    ready: Notify,
}

impl Shared {
    fn usage(&self) -> Usage {
        let meter = self.meter.lock();
        meter.as_ref().map(Meter::usage).unwrap_or_default()
    }
}

/// The threads of a case.
pub(crate) struct Case(Vec<Load>);

impl Case {
    pub(crate) fn of(loads: &[Load]) -> Self {
        Self(loads.to_vec())
    }

    /// Runs it for 10 s and prints a line.
    pub(crate) fn run(&self) {
        if let Err(why) = self.measure() {
            say!("a case did not run: {why}");
        }
    }

    fn measure(&self) -> Result<(), replenish_os::SpawnError> {
        let enforcer = Enforcer::start(EnforcerConfig::on_cpu(0))?;
        let begin = clock::monotonic() + 50 * MS;
        let mut running = Vec::new();
        for load in &self.0 {
            running.push(start(*load, begin, &enforcer)?);
        }
        clock::sleep_until(begin + LENGTH);
        let seen: Vec<_> = running
            .iter()
            .map(|(shared, _)| (shared.bursts.load(Ordering::Relaxed), shared.usage()))
            .collect();
        let stats = enforcer.stats();
        for (load, ((bursts, usage), (_, thread))) in self.0.iter().zip(seen.iter().zip(&running)) {
            let (high, low) = (usage.cpu_high / MS, usage.cpu_low / MS);
            let policy = load.policy;
            match granted(thread.tid()) {
                Ok(granted) => say!("  {policy}: {bursts} [{high}/{low}], granted {granted}"),
                Err(why) => say!("  {policy}: {bursts} [{high}/{low}], not granted: {why}"),
            }
        }
        say!(
            "  enforcer: {} wakes, {} changes, {} refused, {} us",
            stats.wakes,
            stats.changes,
            stats.refused,
            stats.cpu / 1000
        );
        if self
            .0
            .iter()
            .any(|l| matches!(l.policy, Policy::KernelSporadic(_)))
        {
            core::mem::forget(running);
            return Ok(());
        }
        for (shared, _) in &running {
            shared.stop.store(true, Ordering::Relaxed);
        }
        for (_, thread) in running {
            thread.join().ok();
        }
        enforcer.stop();
        Ok(())
    }
}

/// Starts one thread. It enrols itself at once (its creator waits for that), sleeps until the case
/// begins, and then burns bursts.
fn start(
    load: Load,
    begin: u64,
    enforcer: &Arc<Enforcer>,
) -> Result<(Arc<Shared>, Thread<()>), replenish_os::SpawnError> {
    let shared = Arc::new(Shared::default());
    let (theirs, enforcer) = (Arc::clone(&shared), Arc::clone(enforcer));
    let spec = ThreadSpec::new("load").policy(load.policy).stack_size(4096);
    let thread = spawn(spec, move || {
        let enrolled = match &load.policy {
            Policy::Sporadic(params) => enforcer.enroll(params, Kind::Corrected).ok(),
            _ => Some(Account::unbudgeted()),
        };
        let account = enrolled.inspect(|a| *theirs.meter.lock() = Some(a.meter()));
        theirs.ready.set();
        let Some(mut account) = account else { return };
        clock::sleep_until(begin + load.offset);
        account.activate(begin + load.offset);
        while !theirs.stop.load(Ordering::Relaxed) && account.callback_begin().is_ok() {
            burst();
            while load.endless && !theirs.stop.load(Ordering::Relaxed) {
                burst();
            }
            account.callback_end();
            theirs.bursts.fetch_add(1, Ordering::Relaxed);
        }
    })?;
    shared.ready.wait();
    Ok((shared, thread))
}
