//! The flight recorder on its way from the board to the host. The recorded tasks are a worker with
//! a budget that it uses up, and one that sends numbers on topic `loose`, which the host's ping
//! sends back (`ping --echo`). The command line: `recorder MILLISECONDS`.
//!
//! ```text
//!   hungry (2 ms per 20 ms, wants 6)      talker: loose ──► ping ──► loose_back
//!      └────────── ring ◄────────────────────┘
//!   main, below all: the agent's time, pieces on /replenish/recorder
//! ```
//!
//! The emulator sleeps while the board does, so that the board's time is about the host's.
#![no_std]
#![no_main]

extern crate alloc;

use core::sync::atomic::{AtomicI32, AtomicU32, Ordering};
use core::time::Duration;
use firmware::uart::Usart2;
use firmware::{console, say};
use replenish::middleware::xrce::{PortTransport, Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Error, Executor, Mark, Policy, Qos, RecorderFeed};
use replenish_os::freertos::{SealedHeap, panicked, start};
use replenish_os::{Arc, clock};

#[global_allocator]
static HEAP: SealedHeap<{ 88 * 1024 }> = SealedHeap::new();

const MS: u64 = 1_000_000;
/// Below the executor's threads.
const MAIN: u8 = 5;
/// Between two looks at the ring.
const EVERY: u64 = 20 * MS;
/// Pieces at a look.
const PIECES: usize = 4;

static SENT: AtomicI32 = AtomicI32::new(0);
static BACK: AtomicU32 = AtomicU32::new(0);

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(MAIN, 16384, || {
        let mut line = [0_u8; 64];
        let words = console::command_line(&mut line);
        let length = words.split_ascii_whitespace().nth(1);
        let length = length.and_then(|word| word.parse::<u64>().ok());
        let Some(length @ 100..=600_000) = length else {
            say!("the command line is a number of milliseconds, 100 to 600000");
            console::exit(false)
        };
        if let Err(e) = run(length) {
            say!("{e}");
            console::exit(false)
        }
        console::exit(panicked().count == 0 && HEAP.usage().refused == 0)
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

fn run(length: u64) -> Result<(), Error> {
    let config = XrceConfig {
        key: Some(*b"rcdr"),
        connect_timeout: 60_000 * MS,
        ..XrceConfig::small()
    };
    let port = PortTransport::new(Usart2::start(921_600), config.mtu);
    let xrce = Arc::new(Xrce::over("the agent", port, config)?);
    let context = Context::new(Arc::clone(&xrce));
    let node = context.node("board")?;
    let loose = node.publisher::<Int32>("loose", Qos::best_effort())?;
    let mut feed = RecorderFeed::new(&node, "board of the test")?;
    let mut exec = Executor::new(&context);
    exec.on_event(|event| say!("# {event}"));
    let budget = Budget::of(Duration::from_millis(2)).every(Duration::from_millis(20));
    exec.worker("hungry")
        .policy(Policy::fifo(60)?)
        .budget(budget)
        .stack_size(4096)
        .timer(Duration::from_millis(20), |_| {
            let end = clock::thread_cpu() + 6 * MS;
            while clock::thread_cpu() < end {}
        })?;
    let echoed = Mark::new("echoed");
    exec.worker("talker")
        .policy(Policy::fifo(70)?)
        .stack_size(4096)
        .timer(Duration::from_millis(50), move |_| {
            let data = SENT.fetch_add(1, Ordering::Relaxed);
            loose.publish(&Int32 { data })
        })?
        .subscribe(
            &node,
            "loose_back",
            Qos::best_effort(),
            move |echo: &Int32, cx| {
                BACK.fetch_add(1, Ordering::Relaxed);
                cx.mark(echoed, echo.data.unsigned_abs().into());
            },
        )?;
    let running = exec.start()?;
    HEAP.seal();
    let (mut pieces, mut unsent, mut exchanges) = (0, 0, 0);
    let mut ahead = None;
    let mut next = clock::monotonic();
    let end = next + length * MS;
    let mut turn = 0_u32;
    while next < end {
        if turn % 20 == 0 {
            ahead = xrce.agent_clock_offset().ok();
            exchanges += u32::from(ahead.is_some());
        }
        turn += 1;
        match feed.send(&running, ahead, PIECES) {
            Ok(sent) => pieces += sent,
            Err(_) => unsent += 1,
        }
        next += EVERY;
        clock::sleep_until(next);
    }
    // The host looks while the board is still there.
    say!("# look");
    clock::sleep_until(clock::monotonic() + 5_000 * MS);
    let usage = running.usage("hungry").unwrap_or_default();
    say!(
        "{{\"sent\": {}, \"back\": {}, \"pieces\": {pieces}, \"unsent\": {unsent}, \
         \"exchanges\": {exchanges}, \"exhaustions\": {}, \"heap_refused\": {}}}",
        SENT.load(Ordering::Relaxed),
        BACK.load(Ordering::Relaxed),
        usage.exhaustions,
        HEAP.usage().refused,
    );
    core::mem::forget(running);
    Ok(())
}
