//! Budgets and CPU time: suspension, blocking in callbacks, preemption.

use crate::check::{MS, US, hold, join, task};
use firmware::work::Burst;
use replenish_os::Arc;
use replenish_os::freertos::{kernel, tasks};
use replenish_os::{Enforcer, EnforcerConfig, Low, Nanos, Notify, Params, clock, current_tid};
use sporadic::Kind;

pub fn enforcer() -> Arc<Enforcer> {
    match Enforcer::start(EnforcerConfig::on_cpu(0)) {
        Ok(enforcer) => enforcer,
        Err(e) => {
            firmware::say!("wrong: no enforcer: {e}");
            firmware::console::exit(false)
        }
    }
}

/// A worker with `Low::Suspend` gets its budget and nothing more, also on an idle board; the board
/// sleeps meanwhile.
pub fn suspend(_: Burst) {
    let Ok(params) = Params::new(60, Low::Suspend, 20 * MS, 100 * MS, 10) else {
        hold!(false, "no parameters");
        return;
    };
    let enforcer = enforcer();
    let begin = clock::monotonic() + 5 * MS;
    let (tell, its) = (Arc::new(replenish_os::PiMutex::new(None)), enforcer);
    let theirs = Arc::clone(&tell);
    task("worker", 60, move || {
        let Ok(mut account) = its.enroll(&params, Kind::Corrected) else {
            return;
        };
        *theirs.lock() = Some(account.meter());
        clock::sleep_until(begin);
        account.activate(begin);
        loop {
            core::hint::black_box(());
        }
    });
    clock::sleep_until(begin - MS);
    let before = kernel();
    clock::sleep_until(begin + 995 * MS);
    let after = kernel();
    let Some(usage) = tell.lock().as_ref().map(replenish_os::Meter::usage) else {
        hold!(false, "the worker was not enrolled");
        return;
    };
    let (high, low) = (usage.cpu_high, usage.cpu_low);
    hold!(
        high.abs_diff(200 * MS) < 200 * US,
        "{high} ns instead of 200 ms"
    );
    hold!(low < 10 * US, "{low} ns while suspended");
    let n = (usage.exhaustions, usage.replenishments);
    hold!(
        n == (10, 9),
        "{n:?} ends and returns of the budget, not (10, 9)"
    );
    let waits = after.idle_waits.wrapping_sub(before.idle_waits);
    hold!((10..40).contains(&waits), "{waits} sleeps in ten periods");
}

/// Two callbacks of 10 ms per period, each blocked for 7 ms in the middle, are exactly a budget of
/// 20 ms: what is blocked is not charged, and nothing is exhausted.
pub fn blocking_is_free(burst: Burst) {
    let Ok(params) = Params::new(60, Low::Background(6), 21 * MS, 100 * MS, 10) else {
        hold!(false, "no parameters");
        return;
    };
    let enforcer = enforcer();
    let begin = clock::monotonic() + 5 * MS;
    let its = Arc::clone(&enforcer);
    let worker = task("worker", 60, move || {
        let Ok(mut account) = its.enroll(&params, Kind::Corrected) else {
            return None;
        };
        for round in 0..20 {
            let release = begin + round * 50 * MS;
            clock::sleep_until(release);
            account.activate(release);
            account.callback_begin().ok()?;
            burst.run_us(5_000);
            clock::sleep_until(clock::monotonic() + 7 * MS);
            burst.run_us(5_000);
            account.callback_end();
            account.block();
        }
        Some(account.meter().usage())
    });
    let Some(usage) = join(worker) else {
        hold!(false, "the worker was not enrolled");
        return;
    };
    let cpu = usage.cpu_high + usage.cpu_low;
    hold!(
        cpu.abs_diff(200 * MS) < 3 * MS,
        "{cpu} ns of CPU time, not 200 ms"
    );
    hold!(usage.cpu_low == 0, "{} ns at low priority", usage.cpu_low);
    hold!(usage.exhaustions == 0, "{} exhaustions", usage.exhaustions);
    hold!(
        usage.blocked_inside == 20,
        "{} blocks seen in 20 callbacks",
        usage.blocked_inside
    );
}

/// The CPU time of a loop is the same alone and preempted 50 times. Preemption and blocking are
/// distinguished. All of it together is not more than the time that passed.
pub fn cpu_time_exact(burst: Burst) {
    let measure = move || {
        let before = clock::thread_cpu();
        burst.run_us(100_000);
        let cpu = clock::thread_cpu() - before;
        let me = tasks().find(|t| t.tid == current_tid());
        (cpu, me.map_or((0, 0), |t| (t.preemptions, t.blocks)))
    };
    let (alone, (preempted, blocked)) = join(task("alone", 20, measure));
    hold!(blocked == 0, "{blocked} blocks of a loop alone");
    let undisturbed = preempted;
    let begin = clock::monotonic() + MS;
    let passes = Arc::new(Notify::new());
    let other = task("other", 30, move || {
        for i in 0..50 {
            clock::sleep_until(begin + i * 2 * MS);
            burst.run_us(1_000);
        }
        passes.set();
        let me = tasks().find(|t| t.tid == current_tid());
        (clock::thread_cpu(), me.map_or(0, |t| t.blocks))
    });
    let start = clock::monotonic();
    let loops = task("loop", 20, measure);
    let (cpu, (preempted, blocked)) = join(loops);
    let passed = clock::monotonic() - start;
    let (theirs, slept) = join(other);
    // An interrupt and the way into and out of the switch count for the task they meet.
    let added = cpu.saturating_sub(alone);
    hold!(
        cpu >= alone && added < 50 * 40 * US,
        "{added} ns more than alone"
    );
    hold!(
        preempted >= undisturbed + 50,
        "preempted {preempted} times, {undisturbed} when alone"
    );
    hold!(blocked == 0, "{blocked} blocks of a loop");
    hold!(slept >= 50, "blocked {slept} times in 50 sleeps");
    let both: Nanos = cpu + theirs;
    hold!(both <= passed, "{both} ns used of {passed}");
    hold!(passed - both < 2 * MS, "{passed} ns passed, {both} used");
    firmware::say!(
        "alone {alone} ns, preempted {cpu} ns, each preemption {} ns",
        added / 50
    );
}
