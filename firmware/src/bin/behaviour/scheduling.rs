//! Policies that are granted or refused, equals in order of arrival, and an idle board asleep.

use crate::check::{MS, Order, hold, join, my_priority, task};
use alloc::string::ToString;
use firmware::work::Burst;
use replenish_os::freertos::kernel;
use replenish_os::{
    Enforcer, EnforcerConfig, EnrollError, Low, Params, Policy, SchedClass, ThreadSpec, clock,
    current_tid, demote_to_tail, granted, promote, set_priority, spawn,
};
use sporadic::Kind;

/// The kernel grants the priority and the stack that were asked for.
pub fn granted_as_asked(_: Burst) {
    for priority in [1, 2, 50, 98, 99] {
        let task = task("asked", priority, move || {
            let told = granted(current_tid()).map(|g| (g.priority, g.stack_bytes, g.to_string()));
            (told, my_priority())
        });
        let (told, kernels) = join(task);
        let wanted = (
            priority,
            4096,
            alloc::format!("FIFO {priority}, stack 4096 B"),
        );
        hold!(
            told.as_ref() == Ok(&wanted),
            "{told:?} instead of {wanted:?}"
        );
        hold!(
            kernels == priority,
            "the kernel has {kernels}, not {priority}"
        );
    }
    let other = spawn(ThreadSpec::new("other").stack_size(4096), || {
        granted(current_tid()).map(|g| g.priority)
    });
    let told = other.map(join);
    hold!(matches!(told, Ok(Ok(1))), "{told:?} instead of FIFO 1");
}

/// A policy or a CPU that cannot be granted is an error that says what could.
pub fn refused(_: Burst) {
    let ask = |policy, cpu| {
        let spec = ThreadSpec::new("asked").policy(policy).cpu(cpu);
        spawn(spec, || ()).err().map(|e| e.to_string())
    };
    let says = |told: Option<alloc::string::String>, what: &str| {
        let text = told.as_deref().unwrap_or("granted");
        hold!(text.contains(what), "`{text}` does not say `{what}`");
    };
    says(
        ask(Policy::RoundRobin { priority: 5 }, None),
        "FreeRTOS has FIFO",
    );
    let deadline = Policy::deadline(MS, 10 * MS, 10 * MS);
    let Ok(deadline) = deadline else {
        hold!(false, "{deadline:?}");
        return;
    };
    says(ask(deadline, None), "FreeRTOS has FIFO");
    says(ask(Policy::Fifo { priority: 0 }, None), "1");
    says(ask(Policy::Fifo { priority: 100 }, None), "99");
    says(ask(Policy::Fifo { priority: 5 }, Some(1)), "allowed 0");
    let me = current_tid();
    hold!(promote(me, 100).is_err(), "priority 100");
    hold!(promote(me, 0).is_err(), "priority 0");
    hold!(demote_to_tail(me, 100).is_err(), "background 100");
    hold!(
        set_priority(me, SchedClass::RoundRobin(5)).is_err(),
        "round-robin"
    );
    hold!(my_priority() == 90, "a refusal changed the priority");

    let config = EnforcerConfig {
        priority: 50,
        capacity: 1,
        ..EnforcerConfig::on_cpu(0)
    };
    let Ok(enforcer) = Enforcer::start(config) else {
        hold!(false, "no enforcer");
        return;
    };
    let enroll = move |priority| {
        let params = Params::new(priority, Low::Background(6), MS, 10 * MS, 10).ok()?;
        let its = replenish_os::Arc::clone(&enforcer);
        Some(join(task("worker", priority, move || {
            its.enroll(&params, Kind::Corrected).map(drop)
        })))
    };
    let above = enroll(60);
    let wanted = matches!(
        above,
        Some(Err(EnrollError::PriorityTooHigh {
            worker: 60,
            enforcer: 50
        }))
    );
    hold!(wanted, "a worker above its enforcer: {above:?}");
    let first = enroll(40);
    hold!(matches!(first, Some(Ok(()))), "the one place: {first:?}");
    let second = enroll(40);
    let wanted = matches!(second, Some(Err(EnrollError::Full { capacity: 1 })));
    hold!(wanted, "no place is left: {second:?}");
    enforcer_stays(enroll);
}

/// The enforcer lives as long as what can enroll with it.
fn enforcer_stays<T>(enroll: T) {
    drop(enroll);
}

/// Equals run one after another in order of arrival, and one that was preempted goes on first.
pub fn equals_in_order(burst: Burst) {
    let order = Order::new();
    let begin = clock::monotonic() + 5 * MS;
    let equals = ['a', 'b', 'c'].map(|name| {
        let noted = order.clone();
        task("equal", 30, move || {
            clock::sleep_until(begin);
            burst.run_us(5_000);
            noted.note(name);
        })
    });
    let noted = order.clone();
    let above = task("above", 40, move || {
        clock::sleep_until(begin + 2 * MS);
        burst.run_us(1_000);
        noted.note('x');
    });
    join(above);
    equals.into_iter().for_each(join);
    hold!(order.is("xabc"), "in order of arrival, also when preempted");
}

/// With nothing to do, the board sleeps; its timer rings every 4 s to keep the clock, and that is
/// all that happens.
pub fn idle(_: Burst) {
    let before = kernel();
    clock::sleep_until(clock::monotonic() + 60_000 * MS);
    let after = kernel();
    let waits = after.idle_waits.wrapping_sub(before.idle_waits);
    let alarms = after.alarms.wrapping_sub(before.alarms);
    firmware::say!("60 s: {alarms} interrupts of the timer, {waits} sleeps");
    hold!(alarms == 15, "{alarms} interrupts in 60 s");
    hold!(
        waits <= alarms + 1,
        "{waits} sleeps for {alarms} interrupts"
    );
}
