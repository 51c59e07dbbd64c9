//! Damaged bits on the line: the board sends numbers on topic `sure` (reliable) and on topic
//! `loose` (best effort), the host's ping sends them back (`ping --echo`), and what comes back is
//! counted. The command line: `noise COUNT EVERY`: one bit of every EVERYth byte is flipped, in
//! either direction.
#![no_std]
#![no_main]

extern crate alloc;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering};
use firmware::shared_port::SharedPort;
use firmware::uart::Usart2;
use firmware::{console, line, say};
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Context, Error, Event, Executor, Policy, Qos};
use replenish_os::freertos::{SealedHeap, panicked, start};
use replenish_os::{ThreadSpec, clock, spawn};

#[global_allocator]
static HEAP: SealedHeap<{ 100 * 1024 }> = SealedHeap::new();

const MS: u64 = 1_000_000;
/// Below the executor's threads, so that sending is no advantage.
const MAIN: u8 = 40;

/// Keeps the board busy while it waits for the host at set-up: virtual time would jump.
static AWAKE: AtomicBool = AtomicBool::new(true);

/// Answers that came back on one topic.
struct Back {
    received: AtomicU32,
    /// With a number not above the one before.
    again: AtomicU32,
    last: AtomicI32,
}

impl Default for Back {
    fn default() -> Self {
        Self {
            received: AtomicU32::new(0),
            again: AtomicU32::new(0),
            last: AtomicI32::new(-1),
        }
    }
}

impl Back {
    fn take(&self, number: i32) {
        if number < 0 {
            return;
        }
        self.received.fetch_add(1, Ordering::SeqCst);
        if number <= self.last.swap(number, Ordering::SeqCst) {
            self.again.fetch_add(1, Ordering::SeqCst);
        }
    }
}

static LOST: AtomicU32 = AtomicU32::new(0);
static REHEARSED: AtomicU32 = AtomicU32::new(0);

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(MAIN, 16384, || {
        let mut line = [0_u8; 64];
        let words = console::command_line(&mut line);
        let mut numbers = words
            .split_ascii_whitespace()
            .skip(1)
            .map(|w| w.parse::<u32>().ok());
        let (count, every) = (numbers.next().flatten(), numbers.next().flatten());
        let (Some(count @ 1..=1_000), Some(every @ 50..=1_000_000)) = (count, every) else {
            say!("the command line is a count of 1 to 1000 and a distance of 50 to 1000000 bytes");
            console::exit(false)
        };
        if let Err(e) = run(count, every) {
            say!("{e}");
            console::exit(false)
        }
        console::exit(panicked().count == 0 && HEAP.usage().refused == 0)
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

fn run(count: u32, every: u32) -> Result<(), Error> {
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
        key: Some(*b"nois"),
        connect_timeout: 600_000 * MS, // virtual: the emulator may be fast
        request_timeout: 60_000 * MS,
        ..XrceConfig::small()
    };
    let port = SharedPort::new(Usart2::start(921_600), config.mtu);
    let frames = port.clone();
    let context = Context::new(Xrce::over("the agent", port, config)?);
    let node = context.node("noise")?;
    let qos = [Qos::reliable().keep_all(16), Qos::best_effort()];
    let sure = node.publisher::<Int32>("sure", qos[0])?;
    let loose = node.publisher::<Int32>("loose", qos[1])?;
    let backs = [Arc::new(Back::default()), Arc::new(Back::default())];
    let mut exec = Executor::new(&context);
    exec.on_event(|event| {
        if let Event::Link { up: false } = event {
            LOST.fetch_add(1, Ordering::Relaxed);
        }
    });
    let [sure_back, loose_back] = backs.clone();
    exec.worker("back")
        .policy(Policy::fifo(60)?)
        .stack_size(4096)
        .subscribe(&node, "sure_back", qos[0], move |echo: &Int32, _| {
            sure_back.take(echo.data)
        })?
        .subscribe(&node, "loose_back", qos[1], move |echo: &Int32, _| {
            if echo.data < 0 {
                REHEARSED.fetch_add(1, Ordering::SeqCst);
            }
            loose_back.take(echo.data)
        })?;
    let running = exec.start()?;
    let pause = |ms| clock::sleep_until(clock::monotonic() + ms * MS);
    // Until ping is there.
    while REHEARSED.load(Ordering::SeqCst) < 30 {
        loose.publish(&Int32 { data: -1 }).ok();
        pause(10);
    }
    pause(500);
    line::disturb(every);
    let mut loose_sent = 0;
    for n in 0..count as i32 {
        loose_sent += u32::from(loose.publish(&Int32 { data: n }).is_ok());
        // Full is no loss: it is offered again.
        while sure.publish(&Int32 { data: n }).is_err() {
            pause(5);
        }
        pause(10);
    }
    let [sure_back, loose_back] = &backs;
    for _ in 0..600 {
        if sure_back.received.load(Ordering::SeqCst) >= count {
            break;
        }
        pause(100);
    }
    pause(1_000);
    let get = |n: &AtomicU32| n.load(Ordering::SeqCst);
    say!(
        "{{\"sure\": {{\"sent\": {count}, \"back\": {}, \"again\": {}}}, \"loose\": {{\"sent\": {loose_sent}, \"back\": {}, \"again\": {}}},",
        get(&sure_back.received),
        get(&sure_back.again),
        get(&loose_back.received),
        get(&loose_back.again),
    );
    say!(
        "\"link_lost\": {}, \"bytes_damaged\": {}, \"frames_damaged\": {}, \"heap_refused\": {}}}",
        get(&LOST),
        line::counts().damaged,
        frames.stats().damaged,
        HEAP.usage().refused,
    );
    core::mem::forget(running);
    Ok(())
}
