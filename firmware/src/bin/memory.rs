//! The heap that pong takes, step by step.
//!
//! Its agent is in the image, behind the port, and says yes to everything. The words of the command
//! line: how many workers, 1 to 4, and `plain` if they have no budgets.
//!
//! ```text
//!   client ─► frames ─► agent: log-in? yes · object? yes, and acknowledged ─► frames ─► client
//! ```
#![no_std]
#![no_main]

extern crate alloc;

use alloc::boxed::Box;
use core::time::Duration;
use firmware::{console, say};
use replenish::middleware::xrce::{Port, PortTransport, Xrce, XrceConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Error, Executor, Policy, Qos};
use replenish_os::Arc;
use replenish_os::freertos::{SealedHeap, start};
use replenish_os::{Notify, PiMutex};
use replenish_xrce::framing::{SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame};

#[global_allocator]
static HEAP: SealedHeap<{ 88 * 1024 }> = SealedHeap::new();

/// Stack of a worker in bytes; that of dispatcher and enforcer is theirs to say.
const STACK: usize = 4096;

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(97, 16384, || {
        let mut line = [0_u8; 64];
        let words = console::command_line(&mut line);
        let workers = words.split_whitespace().find_map(|w| w.parse().ok());
        let measured = measure(workers.unwrap_or(2), !words.contains("plain"));
        if let Err(e) = &measured {
            say!("it could not be set up: {e:?}");
        }
        console::exit(measured.is_ok() && HEAP.usage().refused == 0)
    });
    say!("the kernel did not start: {}", started.is_ok());
    console::exit(false)
}

/// Use of the heap at the last look, in bytes: each step is the difference to it.
struct Steps(usize);

impl Steps {
    fn took(&mut self) -> usize {
        let used = HEAP.usage().used;
        used - core::mem::replace(&mut self.0, used)
    }
}

fn measure(workers: usize, budgeted: bool) -> Result<(), Error> {
    let agent = Agent::new();
    let mut steps = Steps(HEAP.usage().used);
    let config = XrceConfig {
        key: Some(*b"pong"),
        mtu: 128,
        window: 2,
        max_sample: 64,
        journal: 320 * workers,
        ..XrceConfig::small()
    };
    let port = PortTransport::new(agent, config.mtu);
    let context = Context::new(Xrce::over("agent", port, config)?);
    let node = context.node("pong")?;
    say!("{{\"client\": {},", steps.took());
    let mut exec = Executor::new(&context);
    say!("\"executor\": {},", steps.took());
    let topics = [
        ("first", "first_ping", "first_pong"),
        ("second", "second_ping", "second_pong"),
        ("third", "third_ping", "third_pong"),
        ("fourth", "fourth_ping", "fourth_pong"),
    ];
    let qos = Qos {
        depth: 1,
        ..Qos::best_effort()
    };
    for ((name, ping, pong), priority) in topics.into_iter().zip(50..).take(workers) {
        let answer = node.publisher::<Int32>(pong, qos)?;
        say!("\"publisher {name}\": {},", steps.took());
        let budget = Budget::of(Duration::from_millis(20)).every(Duration::from_millis(100));
        let mut worker = exec
            .worker(name)
            .policy(Policy::fifo(priority)?)
            .stack_size(STACK);
        if budgeted {
            worker = worker.budget(budget);
        }
        say!("\"worker {name}\": {},", steps.took());
        worker.subscribe(&node, ping, qos, move |ping: &Int32, _| {
            answer.publish(ping)
        })?;
        say!("\"subscription {name}\": {},", steps.took());
    }
    let running = exec.start()?;
    say!("\"start\": {},", steps.took());
    HEAP.seal();
    say!("\"stack\": {STACK}, \"workers\": {workers}}}");
    core::mem::forget(running);
    Ok(())
}

/// Agent and line. Not among what is measured.
struct Agent(PiMutex<Box<Line>>);

struct Line {
    frames: Serial<[u8; 512]>,
    back: [u8; 512],
    len: usize,
}

impl Agent {
    fn new() -> Self {
        Self(PiMutex::new(Box::new(Line {
            frames: Serial::new(SERIAL_AGENT, [0; 512]),
            back: [0; 512],
            len: 0,
        })))
    }
}

impl Port for Agent {
    fn read(&self, into: &mut [u8]) -> usize {
        let mut line = self.0.lock();
        let n = line.len.min(into.len());
        into[..n].copy_from_slice(&line.back[..n]);
        let len = line.len;
        line.back.copy_within(n..len, 0);
        line.len -= n;
        n
    }

    fn write(&self, bytes: &[u8]) -> usize {
        let line = &mut **self.0.lock();
        let Line { frames, back, len } = line;
        frames.push(bytes, |_, message| {
            if let Ok(n) = serial_frame(
                SERIAL_AGENT,
                SERIAL_CLIENT,
                &answer(message),
                &mut back[*len..],
            ) {
                *len += n;
            }
        });
        bytes.len()
    }

    fn attach(&self, bell: &Arc<Notify>) {
        bell.set();
    }

    fn baud(&self) -> u32 {
        115_200
    }
}

/// Says yes to each request in a message: the log-in, or those on the reliable stream.
fn answer(message: &[u8]) -> heapless::Vec<u8, 128> {
    let mut out = heapless::Vec::new();
    let mut say = |bytes: &[u8]| out.extend_from_slice(bytes).unwrap_or(());
    let Some(([session, stream, seq @ ..], rest)) = message.split_first_chunk::<4>() else {
        return out;
    };
    // Below 128 the client's key follows the header.
    let mut rest = if *session < 128 { &rest[4..] } else { rest };
    // A log-in names the session that it asks for.
    let session = match rest {
        [0, ..] => rest[16],
        _ => *session,
    };
    say(&[session, 0, 0, 0]);
    while let Some(([kind, _, low, high], body)) = rest.split_first_chunk::<4>() {
        let len = usize::from(*low) | usize::from(*high) << 8;
        let (body, next) = body.split_at(len.min(body.len()));
        match kind {
            // CREATE_CLIENT: STATUS_AGENT
            0 => say(&[4, 1, 11, 0, 0, 0, b'X', b'R', b'C', b'E', 1, 0, 1, 15, 0, 0]),
            // CREATE: STATUS. READ_DATA is answered with data, some time.
            1 => say(&[5, 1, 6, 0, body[0], body[1], body[2], body[3], 0, 0, 0, 0]),
            _ => {}
        }
        rest = &next[(4 - len % 4) % 4 % (next.len() + 1)..];
    }
    if *stream >= 128 {
        let next = u16::from_le_bytes(*seq).wrapping_add(1).to_le_bytes();
        say(&[10, 1, 5, 0, next[0], next[1], 0, 0, *stream]);
    }
    out
}
