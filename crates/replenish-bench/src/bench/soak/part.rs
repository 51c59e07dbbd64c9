//! The soak's own processes: a publisher and a reader, each with one XRCE session.
//!
//! A publisher reads on standard input up to which number to write. It prints how many samples its
//! session has taken and how many of these are acknowledged. A reader prints each number that it
//! gets. Both end with their standard input.

use super::options::Part;
use replenish::Qos;
use replenish::middleware::xrce::{Xrce, XrceConfig};
use replenish::middleware::{EndpointSpec, Interest, Middleware, PublishError, Room};
use replenish::qos::IngressLimit;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::clock;
use std::io::{BufRead, Write};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// The number that a reader says for a damaged sample.
pub(super) const DAMAGED: u32 = u32::MAX;

/// The number that a reader says when samples reach it.
pub(super) const READY: u32 = u32::MAX - 1;

/// Words of a sample: enough for a datagram of its own, so that unacknowledged datagrams are
/// unacknowledged samples.
const WORDS: usize = 75;

const DEPTH: u16 = 256;

fn spec() -> EndpointSpec<'static> {
    EndpointSpec {
        node: "/soak",
        topic: "/steady",
        type_name: "std_msgs/msg/UInt8MultiArray",
        dds_type_name: "std_msgs::msg::dds_::UInt8MultiArray_",
        type_hash: None,
        qos: Qos::reliable().keep_all(DEPTH),
        max_size: WORDS * 4,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

/// Is this part, until its standard input ends.
pub(super) fn run(part: Part, at: SocketAddr, key: u8, first: u32) -> Outcome {
    let session = Arc::new(connect(at, key)?);
    match part {
        Part::Publisher => publisher(&session, first),
        Part::Reader => reader(&session),
    }
}

/// A log-in over a bad link may need several tries.
fn connect(at: SocketAddr, key: u8) -> Result<Xrce, Failure> {
    let config = XrceConfig {
        key: Some([key; 4]),
        ..XrceConfig::default()
    };
    let until = Instant::now() + Duration::from_secs(30);
    loop {
        match Xrce::udp_with(&at.to_string(), config) {
            Ok(session) => return Ok(session),
            Err(error) if Instant::now() > until => return Err(Failure::refused(error)),
            Err(_) => {}
        }
    }
}

fn publisher(session: &Arc<Xrce>, first: u32) -> Outcome {
    let writer = session.create_writer(&spec()).map_err(Failure::refused)?;
    let target = Arc::new(AtomicU32::new(first));
    listen(Arc::clone(&target));
    let driver = Arc::clone(session);
    thread::spawn(move || {
        let mut nobody = Interest::empty();
        while drive(&driver, &mut nobody, &mut |_| ()).is_ok() {}
    });
    let mut next = first;
    let mut said = Instant::now();
    let mut out = std::io::stdout().lock();
    loop {
        let more = next < target.load(Ordering::Relaxed);
        let sample = [next.to_le_bytes(); WORDS].concat();
        match more.then(|| session.publish(writer, &sample)) {
            Some(Ok(())) => next += 1,
            Some(Err(PublishError::Full | PublishError::LinkDown)) | None => {
                thread::sleep(Duration::from_micros(500));
            }
            Some(Err(error)) => return Err(Failure::refused(error)),
        }
        if said.elapsed() > Duration::from_millis(10) {
            said = Instant::now();
            let open = u32::try_from(session.stats().unacknowledged).unwrap_or(u32::MAX);
            let acknowledged = next.saturating_sub(open).max(first);
            let line = writeln!(out, "{next} {acknowledged}").and_then(|()| out.flush());
            if line.is_err() {
                return Ok(()); // nobody listens any more
            }
        }
    }
}

fn reader(session: &Arc<Xrce>) -> Outcome {
    let reader = session.create_reader(&spec()).map_err(Failure::refused)?;
    listen(Arc::default());
    let mut interest = Interest::empty();
    interest.insert(reader);
    let mut out = std::io::stdout().lock();
    let mut numbers = READY.to_le_bytes().to_vec();
    loop {
        drive(session, &mut interest, &mut |sample| {
            let number = sample.first_chunk::<4>().copied().unwrap_or_default();
            let whole = sample.len() == WORDS * 4 && sample.chunks(4).all(|word| word == number);
            let number = if whole {
                u32::from_le_bytes(number)
            } else {
                DAMAGED
            };
            numbers.extend(number.to_le_bytes());
        })?;
        if out.write_all(&numbers).and_then(|()| out.flush()).is_err() {
            return Ok(());
        }
        numbers.clear();
    }
}

/// Does one turn of a dispatcher: waits for 10 ms at most, then takes the samples.
fn drive(session: &Xrce, interest: &mut Interest, got: &mut dyn FnMut(&[u8])) -> Outcome {
    let deadline = clock::monotonic() + 10_000_000;
    session
        .wait(interest, Some(deadline))
        .map_err(Failure::refused)?;
    let mut sink = |_, _: &_, sample: &[u8]| {
        got(sample);
        Room::Left
    };
    session
        .take(interest, &mut sink)
        .map_err(Failure::refused)?;
    Ok(())
}

/// Takes targets from standard input, and ends the process with it.
fn listen(target: Arc<AtomicU32>) {
    thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if let Ok(number) = line.trim().parse() {
                target.store(number, Ordering::Relaxed);
            }
        }
        std::process::exit(0);
    });
}
