//! Round trips over the serial line: the board sends a message on topic `loose`, the host's ping
//! sends it back (`ping --echo`), the next one follows 20 ms after. The command line: `trip COUNT
//! BAUD`.
//!
//! The clock stands still from the moment the message has left until its echo has come, so that
//! agent and ping take no time: what is measured is the board and the line.
#![no_std]
#![no_main]

extern crate alloc;

use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use firmware::uart::{self, Usart2};
use firmware::{console, line, say};
use replenish::middleware::xrce::{PortTransport, Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Error, Executor, Policy, Publisher, Qos};
use replenish_os::freertos::{AtomicU64, SealedHeap, panicked, start};
use replenish_os::{Notify, ThreadSpec, clock, spawn};

#[global_allocator]
static HEAP: SealedHeap<{ 100 * 1024 }> = SealedHeap::new();

const MS: u64 = 1_000_000;
/// Below the executor's threads, so that sending is no advantage.
const MAIN: u8 = 40;

/// Keeps the board busy while it waits for the host at set-up: virtual time would jump.
static AWAKE: AtomicBool = AtomicBool::new(true);

/// The number and the time of the last answer, which the callback leaves for the main task.
#[derive(Default)]
struct Back {
    number: AtomicI32,
    at: AtomicU64,
    bell: Notify,
}

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(MAIN, 16384, || {
        let mut line = [0_u8; 64];
        let words = console::command_line(&mut line);
        let mut numbers = words
            .split_ascii_whitespace()
            .skip(1)
            .map(|w| w.parse::<u32>().ok());
        let (count, baud) = (numbers.next().flatten(), numbers.next().flatten());
        let (Some(count @ 1..=1_000), Some(baud @ 1_200..=4_000_000)) = (count, baud) else {
            say!("the command line is a count of 1 to 1000 and a baud rate of 1200 to 4000000");
            console::exit(false)
        };
        if let Err(e) = run(count, baud) {
            say!("{e}");
            console::exit(false)
        }
        console::exit(panicked().count == 0 && HEAP.usage().refused == 0)
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

fn run(count: u32, baud: u32) -> Result<(), Error> {
    let awake = ThreadSpec::new("awake")
        .policy(Policy::fifo(1)?)
        .stack_size(1024);
    let body = || {
        while AWAKE.load(Ordering::Relaxed) {
            core::hint::black_box(());
        }
    };
    if let Err(e) = spawn(awake, body) {
        say!("no task: {e}");
        console::exit(false)
    }
    let config = XrceConfig {
        key: Some(*b"trip"),
        connect_timeout: 600_000 * MS, // virtual: the emulator may be fast
        request_timeout: 60_000 * MS,
        ..XrceConfig::small()
    };
    let port = PortTransport::new(Usart2::start(baud), config.mtu);
    let context = Context::new(Xrce::over("the agent", port, config)?);
    let node = context.node("trip")?;
    let loose = node.publisher::<Int32>("loose", Qos::best_effort())?;
    let back = Arc::new(Back::default());
    let told = Arc::clone(&back);
    let mut exec = Executor::new(&context);
    exec.on_event(|event| say!("# {event}"));
    exec.worker("back")
        .policy(Policy::fifo(60)?)
        .stack_size(4096)
        .subscribe(
            &node,
            "loose_back",
            Qos::best_effort(),
            move |echo: &Int32, _| {
                told.at.store(clock::monotonic(), Ordering::SeqCst);
                told.number.store(echo.data, Ordering::SeqCst);
                told.bell.set();
            },
        )?;
    let running = exec.start()?;
    let mut trips: Vec<(u64, u32, u32)> = Vec::with_capacity(count as usize);
    // Until ping is there.
    while back.number.load(Ordering::SeqCst) >= 0 {
        loose.publish(&Int32 { data: -1 }).ok();
        clock::sleep_until(clock::monotonic() + 10 * MS);
    }
    clock::sleep_until(clock::monotonic() + 500 * MS);
    AWAKE.store(false, Ordering::SeqCst);
    let mut lost = 0;
    for n in 0..count {
        match trip(&loose, &back, n as i32) {
            Some(trip) => trips.push(trip),
            None => lost += 1,
        }
        clock::sleep_until(clock::monotonic() + 20 * MS);
    }
    AWAKE.store(true, Ordering::SeqCst);
    say!("{{\"baud\": {baud}, \"count\": {count}, \"lost\": {lost}, \"trips\": [");
    for (i, (ns, sent, received)) in trips.iter().enumerate() {
        let comma = if i > 0 { "," } else { "" };
        say!("{comma}[{ns}, {sent}, {received}]");
    }
    say!("]}}");
    core::mem::forget(running);
    Ok(())
}

/// Sends one message there and back. Returns ns from before it is published to the beginning of the
/// callback, and the bytes that passed the line meanwhile, from the board and to it. `None`: it did
/// not come back.
fn trip(loose: &Publisher<Int32>, back: &Back, number: i32) -> Option<(u64, u32, u32)> {
    let before = uart::counts();
    let begin = clock::monotonic();
    loose.publish(&Int32 { data: number }).ok()?;
    line::expect(1);
    while back.number.load(Ordering::SeqCst) != number {
        if !back.bell.wait_until(begin + 1_000 * MS) {
            return None;
        }
    }
    let after = uart::counts();
    Some((
        back.at.load(Ordering::SeqCst) - begin,
        after.sent.wrapping_sub(before.sent),
        after.received.wrapping_sub(before.received),
    ))
}
