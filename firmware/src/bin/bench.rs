//! The cost of switching and handing over, in instructions: under QEMU's `-icount` each takes 8 ns.
//!
//! Every figure is the mean of 1000 rounds, which are all alike, less what an empty round costs.
#![no_std]
#![no_main]

extern crate alloc;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::regs::{IRQ_USART2, Reg, enable_interrupt};
use firmware::{console, say};
use replenish_os::freertos::{SealedHeap, start};
use replenish_os::{
    Enforcer, EnforcerConfig, Low, Nanos, Notify, Params, PiMutex, Policy, ThreadSpec, clock, spawn,
};
use sporadic::Kind;

#[global_allocator]
static HEAP: SealedHeap<{ 64 * 1024 }> = SealedHeap::new();

const ROUNDS: u32 = 1000;
const NS_PER_INSTRUCTION: Nanos = 8;

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(90, 8192, || {
        measure();
        console::exit(true)
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

fn measure() {
    let figures = [
        ("context_switch", on_task(50, context_switch)),
        ("hand_off", on_task(50, hand_off)),
        ("interrupt_to_task", on_task(50, interrupt_to_task)),
        ("set_without_waiter", on_task(50, set_without_waiter)),
        ("lock_and_unlock", on_task(50, lock_and_unlock)),
        ("activate_and_block", on_task(50, activate_and_block)),
        ("read_clock", on_task(50, read_clock)),
        ("read_cpu_time", on_task(50, read_cpu_time)),
    ];
    say!(
        "{{\"ns_per_instruction\": {NS_PER_INSTRUCTION}, \"rounds\": {ROUNDS}, \"instructions\": {{"
    );
    for (i, (name, instructions)) in figures.iter().enumerate() {
        let comma = if i + 1 < figures.len() { "," } else { "" };
        say!("\"{name}\": {instructions}{comma}");
    }
    say!("}}}}");
}

/// The figure that `body` returns, taken on a task of its own.
fn on_task(priority: u8, body: fn() -> u32) -> u32 {
    let spec = ThreadSpec::new("bench").policy(Policy::Fifo { priority });
    match spawn(spec.stack_size(3072), body).map(|t| t.join()) {
        Ok(Ok(figure)) => figure,
        _ => console::exit(false),
    }
}

/// Instructions per round.
fn each(mut round: impl FnMut()) -> u32 {
    let begin = clock::monotonic();
    for i in 0..ROUNDS {
        core::hint::black_box(i);
    }
    let between = clock::monotonic();
    for i in 0..ROUNDS {
        core::hint::black_box(i);
        round();
    }
    let end = clock::monotonic();
    let net = (end - between).saturating_sub(between - begin);
    (net / NS_PER_INSTRUCTION / Nanos::from(ROUNDS)) as u32
}

/// Out of a task and into one: the exception, both sets of registers, the choice, both hooks. That
/// it is the same task changes nothing.
fn context_switch() -> u32 {
    each(|| {
        Reg(0xE000_ED04).set(1 << 28); // ICSR: pend PendSV
        // SAFETY: barriers; the switch happens here.
        unsafe { core::arch::asm!("dsb", "isb") };
    })
}

/// From `set` in one task to the return of `wait` in another above it: half of a round trip.
fn hand_off() -> u32 {
    let there = Arc::new((Notify::new(), Notify::new()));
    let theirs = Arc::clone(&there);
    let spec = ThreadSpec::new("other").policy(Policy::Fifo { priority: 51 });
    let other = spawn(spec.stack_size(2048), move || {
        for _ in 0..ROUNDS {
            theirs.0.wait();
            theirs.1.set();
        }
    });
    if other.is_err() {
        console::exit(false);
    }
    each(|| {
        there.0.set();
        there.1.wait();
    }) / 2
}

static BELL: Notify = Notify::new();
static RAISED: AtomicU32 = AtomicU32::new(0);
static TOOK: AtomicU32 = AtomicU32::new(0);

/// From the raising of an interrupt to the task that its handler signals. Read off the clock,
/// whose ticks are 31 instructions: the mean of 1000 knows better.
fn interrupt_to_task() -> u32 {
    firmware::board::on_usart2(|| BELL.set());
    enable_interrupt(IRQ_USART2);
    let spec = ThreadSpec::new("woken").policy(Policy::Fifo { priority: 51 });
    let other = spawn(spec.stack_size(2048), move || {
        for _ in 0..ROUNDS {
            BELL.wait();
            let now = clock::monotonic() as u32;
            TOOK.fetch_add(now - RAISED.load(Ordering::Relaxed), Ordering::Relaxed);
        }
    });
    if other.is_err() {
        console::exit(false);
    }
    for i in 0..ROUNDS {
        for _ in 0..i % 31 {
            core::hint::black_box(i); // not always at the same place between two ticks
        }
        RAISED.store(clock::monotonic() as u32, Ordering::Relaxed);
        Reg(0xE000_E200 + IRQ_USART2 / 32 * 4).set(1 << (IRQ_USART2 % 32));
        // SAFETY: a barrier; the interrupt comes here.
        unsafe { core::arch::asm!("isb") };
    }
    let sum = Nanos::from(TOOK.load(Ordering::Relaxed));
    (sum / NS_PER_INSTRUCTION / Nanos::from(ROUNDS)) as u32
}

fn set_without_waiter() -> u32 {
    let signal = Notify::new();
    each(|| {
        signal.set();
        signal.take();
    })
}

fn lock_and_unlock() -> u32 {
    let lock = PiMutex::new(0_u32);
    each(|| *lock.lock() += 1)
}

/// The cost of a budget to a worker that wakes, works and waits again within it.
fn activate_and_block() -> u32 {
    let enforcer = Enforcer::start(EnforcerConfig::on_cpu(0));
    let params = Params::new(50, Low::Background(6), 50_000_000, 100_000_000, 10);
    let (Ok(enforcer), Ok(params)) = (enforcer, params) else {
        console::exit(false)
    };
    let Ok(mut account) = enforcer.enroll(&params, Kind::Corrected) else {
        console::exit(false)
    };
    each(|| {
        account.activate(clock::monotonic());
        account.block();
    })
}

fn read_clock() -> u32 {
    each(|| {
        core::hint::black_box(clock::monotonic());
    })
}

fn read_cpu_time() -> u32 {
    each(|| {
        core::hint::black_box(clock::thread_cpu());
    })
}
