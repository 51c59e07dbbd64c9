//! Budgets on the board: workers that burn 10 ms bursts, case by case, each on a fresh boot.
//!
//! The host writes the case over the console's command line (semihosting), one worker per word:
//! `P/L/B/T@offset` in ms or `P` for a worker without a budget, then the measured seconds. The
//! counts come back as JSON.
#![no_std]
#![no_main]

extern crate alloc;

use alloc::vec::Vec;
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::case::{self, Worker};
use firmware::console;
use firmware::say;
use firmware::work::Burst;
use replenish_os::Arc;
use replenish_os::freertos::{SealedHeap, panicked, start};
use replenish_os::{Enforcer, EnforcerConfig, Policy, ThreadSpec, clock, spawn};

#[global_allocator]
static HEAP: SealedHeap<{ 48 * 1024 }> = SealedHeap::new();

/// The main task is above the workers, so that it ends the measurement on time.
const MAIN_PRIORITY: u8 = 90;

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(MAIN_PRIORITY, 8192, run);
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

fn run() {
    let mut line = [0_u8; 256];
    let outcome = case::read(console::command_line(&mut line)).map(|case| measure(&case));
    match outcome {
        Ok(()) => console::exit(panicked().count == 0 && HEAP.usage().refused == 0),
        Err(what) => {
            say!("the case was not understood: {what}");
            console::exit(false)
        }
    }
}

/// Runs the workers of the case and prints what each did.
fn measure(case: &case::Case) {
    let burst = Burst::calibrate();
    let Ok(enforcer) = Enforcer::start(EnforcerConfig::on_cpu(0)) else {
        say!("no enforcer");
        console::exit(false)
    };
    let begin = clock::monotonic() + 20_000_000;
    let mut meters = Vec::new();
    for worker in &case.workers {
        meters.push(launch(*worker, burst, begin, &enforcer));
    }
    HEAP.seal();
    clock::sleep_until(begin + case.length);
    let elapsed = clock::monotonic() - begin;
    say!("{{\"elapsed_ns\": {elapsed}, \"workers\": [");
    for (i, (worker, count)) in case.workers.iter().zip(&meters).enumerate() {
        let comma = if i + 1 < meters.len() { "," } else { "" };
        let bursts = count.bursts.load(Ordering::Relaxed);
        let usage = count.usage();
        say!(
            "{{\"priority\": {}, \"budget_ms\": {}, \"period_ms\": {}, \"offset_ms\": {}, \"bursts\": {bursts}, \
             \"cpu_high_ns\": {}, \"cpu_low_ns\": {}, \"exhaustions\": {}, \"replenishments\": {}}}{comma}",
            worker.priority,
            worker.budget / 1_000_000,
            worker.period / 1_000_000,
            worker.offset / 1_000_000,
            usage.cpu_high,
            usage.cpu_low,
            usage.exhaustions,
            usage.replenishments,
        );
    }
    let stats = enforcer.stats();
    let heap = HEAP.usage();
    say!(
        "], \"enforcer\": {{\"wakes\": {}, \"changes\": {}, \"cpu_ns\": {}}}, \"heap_used_bytes\": {}, \"heap_refused\": {}}}",
        stats.wakes,
        stats.changes,
        stats.cpu,
        heap.used,
        heap.refused,
    );
}

struct Count {
    bursts: AtomicU32,
    meter: replenish_os::PiMutex<Option<replenish_os::Meter>>,
}

impl Count {
    fn usage(&self) -> replenish_os::Usage {
        self.meter
            .lock()
            .as_ref()
            .map(replenish_os::Meter::usage)
            .unwrap_or_default()
    }
}

/// Starts one worker. It enrolls itself at once (its creator waits for that), sleeps until the
/// case begins, and then burns bursts for ever.
fn launch(worker: Worker, burst: Burst, begin: u64, enforcer: &Arc<Enforcer>) -> Arc<Count> {
    let count = Arc::new(Count {
        bursts: AtomicU32::new(0),
        meter: replenish_os::PiMutex::new(None),
    });
    let theirs = Arc::clone(&count);
    let enforcer = Arc::clone(enforcer);
    let ready = Arc::new(replenish_os::Notify::new());
    let tell = Arc::clone(&ready);
    let policy = Policy::Fifo {
        priority: worker.priority,
    };
    let spec = ThreadSpec::new("worker").policy(policy).stack_size(4096);
    let body = move || {
        let account = match worker.params() {
            Some(params) => enforcer.enroll(&params, sporadic::Kind::Corrected).ok(),
            None => Some(replenish_os::Account::unbudgeted()),
        };
        let Some(mut account) = account else {
            say!("a worker was not enrolled");
            console::exit(false)
        };
        *theirs.meter.lock() = Some(account.meter());
        tell.set();
        clock::sleep_until(begin + worker.offset);
        account.activate(begin + worker.offset);
        if worker.endless {
            loop {
                // Not `spin_loop`: QEMU leaves its translated code at every `yield`.
                core::hint::black_box(());
            }
        }
        loop {
            if account.callback_begin().is_err() {
                return;
            }
            burst.run();
            account.callback_end();
            theirs.bursts.fetch_add(1, Ordering::Relaxed);
        }
    };
    if let Err(e) = spawn(spec, body) {
        say!("no worker: {e}");
        console::exit(false)
    }
    ready.wait();
    count
}
