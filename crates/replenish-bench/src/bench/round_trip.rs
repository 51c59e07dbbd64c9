//! `replenish bench round-trip`: client to agent to client, next to a raw UDP echo.
//!
//! ```text
//!   raw-udp       client thread ── send/recv ──► echo thread
//!   best-effort   client thread ── WRITE_DATA ─► agent thread ── DATA ──► client thread
//!   reliable      the same on reliable streams, each way acknowledged
//! ```
//!
//! One client thread drives all paths in windows that take turns, so that each path sees the same
//! machine; echo and agent have the same CPU and the same policy. A round trip begins before the
//! write and ends when the sample is in the client's hands.

use super::agent_cpus::AgentCpus;
use crate::load::spec::SUPPORT_PRIORITY;
use crate::load::{MS, Nanos, SEC};
use crate::load_client::{Client, Endpoint};
use replenish_agent::{Agent, AgentConfig, StopHandle};
use replenish_cli::lock;
use replenish_cli::machine::fifo_or_other;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::report::table::Table;
use replenish_os::clock::{self, ThreadCpuClock};
use replenish_os::{Policy, PollFd, Thread, ThreadSpec, current_tid, granted, poll, spawn};
use replenish_xrce::stream::AckPolicy;
use replenish_xrce::wire::StreamId;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Round trips in one window of one path.
const WINDOW: usize = 200;

/// Round trips of a window that do not count: caches and queues settle.
const WARM_UP: usize = 20;

/// Time in ns after which a round trip counts as lost.
const PATIENCE: Nanos = SEC;

/// Options of `bench round-trip`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Round trips on each path.
    #[arg(long, value_name = "N", default_value_t = 10_000,
          value_parser = clap::value_parser!(u64).range(200..=1_000_000))]
    samples: u64,

    /// Bytes of a message.
    #[arg(long, value_name = "BYTES", default_value_t = 64,
          value_parser = clap::value_parser!(u64).range(8..=900))]
    bytes: u64,

    #[command(flatten)]
    cpus: AgentCpus,

    #[command(flatten)]
    json: JsonOption,
}

/// One of `points`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Point {
    path: &'static str,
    p50_us: f64,
    p99_us: f64,
    max_us: f64,
    cpu_us_per_message: f64,
    client_cpu_us_per_message: f64,
    samples: usize,
    lost: u64,
    /// The median over windows of this path's median over that of the raw echo's window.
    ratio_p50: f64,
}

/// `bench round-trip --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
struct Json {
    points: Vec<Point>,
    bytes: usize,
    client_cpu: usize,
    agent_cpu: usize,
    granted: String,
}

/// A way there and back.
trait Path {
    /// Makes one round trip; returns the time of its end, or `None` if the answer did not come.
    fn round_trip(&mut self, payload: &[u8]) -> Result<Option<Nanos>, Failure>;

    /// Lets what is under way settle, so that it does not disturb the next path's window.
    fn settle(&mut self) -> Result<(), Failure>;
}

/// The raw echo's client side.
struct Raw {
    socket: UdpSocket,
    buf: Vec<u8>,
}

impl Path for Raw {
    fn round_trip(&mut self, payload: &[u8]) -> Result<Option<Nanos>, Failure> {
        self.socket.send(payload).map_err(Failure::refused)?;
        let until = clock::monotonic() + PATIENCE;
        loop {
            // The same wait as the client of the agent has, lest the wait be what is compared.
            let mut fds = [PollFd::readable(&self.socket)];
            if poll(&mut fds, Some(until)).map_err(Failure::refused)? == 0 {
                return Ok(None);
            }
            let len = self.socket.recv(&mut self.buf).map_err(Failure::refused)?;
            if self.buf.get(..len) == Some(payload) {
                return Ok(Some(clock::monotonic()));
            }
        }
    }

    fn settle(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}

/// A client that hears itself through the agent.
struct ThroughAgent {
    client: Client,
    stream: StreamId,
}

impl ThroughAgent {
    fn new(agent: SocketAddr, key: u32, stream: StreamId) -> Result<Self, Failure> {
        let mut client = Client::connect(agent, key, AckPolicy::default())?;
        let topic = &format!("bench/{key}");
        let endpoints = [Endpoint {
            number: 1,
            topic,
            depth: 10,
        }];
        client.equip(&endpoints, &endpoints, stream)?;
        client.await_up(5 * SEC)?;
        Ok(Self { client, stream })
    }
}

impl Path for ThroughAgent {
    fn round_trip(&mut self, payload: &[u8]) -> Result<Option<Nanos>, Failure> {
        let mut back = false;
        let now = clock::monotonic();
        let until = now + PATIENCE;
        if !self.client.write(1, self.stream, payload)? {
            return Ok(None);
        }
        self.client.send(now, &mut |_, _| {})?;
        loop {
            self.client
                .wait(self.client.deadline().unwrap_or(until).min(until))?;
            let now = clock::monotonic();
            let heard = self
                .client
                .receive(now, &mut |_, got: &[u8]| back |= got == payload)?;
            if back {
                // The sample is here; what is owed to the agent goes out after that.
                let arrived = clock::monotonic();
                self.client.send(arrived, &mut |_, _| {})?;
                return Ok(Some(arrived));
            }
            self.client.send(now, &mut |_, _| {})?;
            if !heard && now >= until {
                return Ok(None);
            }
        }
    }

    fn settle(&mut self) -> Result<(), Failure> {
        let until = clock::monotonic() + SEC;
        while !self.client.is_delivered() && clock::monotonic() < until {
            self.client.wait(clock::monotonic() + MS)?;
            self.client.serve(clock::monotonic(), &mut |_, _| {})?;
        }
        self.client.serve(clock::monotonic(), &mut |_, _| {})
    }
}

/// Measurements of one path.
#[derive(Debug, Default)]
struct Record {
    times: Vec<i64>,
    medians: Vec<i64>,
    client_cpu: Nanos,
    server_cpu: Nanos,
    lost: u64,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    let (client_cpu, agent_cpu) = args.cpus.chosen()?;
    files::check_writable(args.json.json.as_deref())?;
    let _alone = lock::acquire()?;

    let policy = fifo_or_other(SUPPORT_PRIORITY);
    let stop = StopHandle::new();
    let ended = Arc::new(AtomicBool::new(false));
    let agent = agent(policy, agent_cpu, stop.clone())?;
    let echo = echo(policy, agent_cpu, Arc::clone(&ended))?;
    let servers = [echo.thread.tid(), agent.thread.tid()].map(ThreadCpuClock::of);
    let (raw, xrce) = (echo.address, agent.address);
    let bytes = usize::try_from(args.bytes).unwrap_or(64);
    let windows = usize::try_from(args.samples).unwrap_or(usize::MAX) / (WINDOW - WARM_UP) + 1;
    let body = move || measure(raw, xrce, servers, windows, bytes);
    let measured = spawn(
        ThreadSpec::new("client").policy(policy).cpu(client_cpu),
        body,
    )
    .map_err(Failure::refused)?
    .join();
    stop.stop();
    ended.store(true, Ordering::Release);
    // Wakes the echo out of its wait.
    if let Ok(socket) = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)) {
        socket.send_to(&[], raw).ok();
    }
    for server in [agent, echo] {
        let outcome = server.thread.join();
        outcome.map_err(|_| Failure::refused("a thread panicked"))??;
    }
    let (records, granted) =
        measured.map_err(|_| Failure::refused("the client's thread panicked"))??;
    let json = Json {
        points: points(records),
        bytes,
        client_cpu,
        agent_cpu,
        granted,
    };
    print(&json);
    files::write_json(args.json.json.as_deref(), "bench-round-trip", &json)?;
    match json.points.iter().find(|point| point.lost > 0) {
        Some(point) => Err(Failure::refused(format!(
            "{} messages of {} did not come back",
            point.lost, point.path
        ))),
        None => Ok(()),
    }
}

/// A thread that answers, and where.
struct Server {
    thread: Thread<Outcome>,
    address: SocketAddr,
}

fn agent(policy: Policy, cpu: usize, stop: StopHandle) -> Result<Server, Failure> {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        ..AgentConfig::default()
    };
    let mut agent = Agent::bind(&config).map_err(Failure::refused)?;
    let address = agent.local_addr();
    let spec = ThreadSpec::new("xrce-agent").policy(policy).cpu(cpu);
    let thread = spawn(spec, move || agent.run(&stop).map_err(Failure::refused));
    let thread = thread.map_err(Failure::refused)?;
    Ok(Server { thread, address })
}

/// The plainest echo there is: one blocking receive and one send for a message.
fn echo(policy: Policy, cpu: usize, ended: Arc<AtomicBool>) -> Result<Server, Failure> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::refused)?;
    let address = socket.local_addr().map_err(Failure::refused)?;
    let body = move || {
        let mut buf = vec![0; 2048];
        while !ended.load(Ordering::Acquire) {
            let (len, from) = socket.recv_from(&mut buf).map_err(Failure::refused)?;
            let message = buf.get(..len).unwrap_or_default();
            // A client that has gone does not miss the answer.
            socket.send_to(message, from).ok();
        }
        Ok(())
    };
    let spec = ThreadSpec::new("udp-echo").policy(policy).cpu(cpu);
    let thread = spawn(spec, body).map_err(Failure::refused)?;
    Ok(Server { thread, address })
}

const PATHS: [&str; 3] = ["raw-udp", "best-effort", "reliable"];

/// All windows of all paths; and the policy of the thread that drives them.
fn measure(
    raw: SocketAddr,
    xrce: SocketAddr,
    [echo, agent]: [ThreadCpuClock; 2],
    windows: usize,
    bytes: usize,
) -> Result<([Record; 3], String), Failure> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::refused)?;
    socket.connect(raw).map_err(Failure::refused)?;
    let mut raw = Raw {
        socket,
        buf: vec![0; 2048],
    };
    let mut best_effort = ThroughAgent::new(xrce, 0x7274_0001, StreamId::BEST_EFFORT)?;
    let mut reliable = ThroughAgent::new(xrce, 0x7274_0002, StreamId::RELIABLE)?;
    let mut records: [Record; 3] = Default::default();
    let mut payload = vec![0_u8; bytes];
    let mut count = 0_u64;
    for _ in 0..windows {
        let paths: [(&mut dyn Path, ThreadCpuClock); 3] = [
            (&mut raw, echo),
            (&mut best_effort, agent),
            (&mut reliable, agent),
        ];
        for ((path, server), record) in paths.into_iter().zip(&mut records) {
            let mut times = Vec::with_capacity(WINDOW);
            let cpu = || (clock::thread_cpu(), server.read().unwrap_or(0));
            let mut begun = cpu();
            for i in 0..WINDOW {
                if i == WARM_UP {
                    begun = cpu();
                }
                count += 1;
                if let Some(stamp) = payload.first_chunk_mut::<8>() {
                    *stamp = count.to_le_bytes();
                }
                let sent = clock::monotonic();
                match path.round_trip(&payload)? {
                    Some(back) if i >= WARM_UP => {
                        let time = back.saturating_sub(sent);
                        times.push(i64::try_from(time).unwrap_or(i64::MAX));
                    }
                    Some(_) => {}
                    None => record.lost += 1,
                }
            }
            path.settle()?;
            let ended = cpu();
            record.client_cpu += ended.0.saturating_sub(begun.0);
            record.server_cpu += ended.1.saturating_sub(begun.1);
            let window = Sorted::new(times.clone());
            record.medians.push(window.median());
            record.times.extend(times);
            // Keeps far from the RT throttle, whatever the number of samples.
            clock::sleep_until(clock::monotonic() + 2 * MS);
        }
    }
    let granted = granted(current_tid()).map_err(Failure::refused)?;
    Ok((records, granted.to_string()))
}

fn points(records: [Record; 3]) -> Vec<Point> {
    let base: Vec<i64> = records.first().map_or(Vec::new(), |r| r.medians.clone());
    let point = |(path, record): (&'static str, Record)| {
        let Record { medians, .. } = &record;
        let permille = |(ours, theirs): (&i64, &i64)| ours.saturating_mul(1000) / (*theirs).max(1);
        let ratios = medians.iter().zip(&base).map(permille).collect();
        let times = Sorted::new(record.times);
        let each = |cpu: Nanos| cpu as f64 / 1e3 / (times.len().max(1) as f64);
        Point {
            path,
            p50_us: us(times.median()),
            p99_us: us(times.percentile(99)),
            max_us: us(times.max()),
            cpu_us_per_message: each(record.client_cpu + record.server_cpu),
            client_cpu_us_per_message: each(record.client_cpu),
            samples: times.len(),
            lost: record.lost,
            ratio_p50: Sorted::new(ratios).median() as f64 / 1e3,
        }
    };
    PATHS.into_iter().zip(records).map(point).collect()
}

fn print(json: &Json) {
    let mut table = Table::new(&["path", "p50 us", "p99 us", "max us", "CPU us", "x raw p50"]);
    for point in &json.points {
        let figures = [
            point.p50_us,
            point.p99_us,
            point.max_us,
            point.cpu_us_per_message,
        ];
        let figures = figures.map(|us| format!("{us:.1}"));
        let ratio = format!("{:.2}", point.ratio_p50);
        table.row(
            [point.path.to_string()]
                .into_iter()
                .chain(figures)
                .chain([ratio]),
        );
    }
    println!(
        "{}  {} bytes, client on CPU {}, agent and echo on CPU {}, all {}; the paths take turns, the \
         last column is the median of the windows' ratios",
        table.to_text(),
        json.bytes,
        json.client_cpu,
        json.agent_cpu,
        json.granted
    );
}
