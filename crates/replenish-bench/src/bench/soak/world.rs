//! The soak's processes and link, and the faults that they suffer.

use super::ledger::Ledger;
use super::options::{Args, Fault};
use super::process::Process;
use super::proxy::Proxy;
use replenish_cli::outcome::Failure;
use replenish_xrce::client;
use replenish_xrce::wire::RequestId;
use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::process::ChildStdout;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Longer than anything takes on a machine that works.
const PATIENCE: Duration = Duration::from_secs(120);

/// Samples that a killed publisher may have taken beyond the number that it last printed.
const UNSAID: u32 = 100_000;

/// A reader that returns later after an agent's end returns too late: `docs/acknowledged.md`.
const RECOVERY: Duration = Duration::from_millis(2400);

/// The publisher's numbers: taken, and acknowledged.
type Said = Arc<Mutex<(u32, u32)>>;

/// Everything that runs.
#[derive(Debug)]
pub(super) struct World {
    agent: Option<Process>,
    publisher: Process,
    reader: Process,
    other: Process,
    pub(super) proxy: Proxy,
    address: SocketAddr,
    said: Said,
    /// The first sample of the publisher that lives, and of the part that is being written.
    first: u32,
    part: u32,
    stall: Duration,
    pub(super) ledger: Arc<Mutex<Ledger>>,
}

fn guard<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

#[allow(clippy::needless_pass_by_value, reason = "what `map_err` gives it")]
fn system(e: std::io::Error) -> Failure {
    Failure::refused(format!("the soak's sockets: {e}"))
}

impl World {
    /// Starts all of it.
    pub(super) fn start(args: &Args) -> Result<Self, Failure> {
        let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(system)?;
        let address = free.local_addr().map_err(system)?;
        drop(free);
        let proxy = Proxy::start(address, args).map_err(system)?;
        let agent = Some(start_agent(address)?);
        let ledger = Arc::new(Mutex::new(Ledger::new()));
        let mut reader = part("reader", proxy.address, 1, 0)?;
        let (output, sink) = (reader.output()?, Arc::clone(&ledger));
        thread::spawn(move || read(output, &mut |number| guard(&sink).arrive(number)));
        let other = other_reader(&proxy)?;
        let said = Said::default();
        let publisher = start_publisher(&proxy, &said, 0)?;
        let world = Self {
            agent,
            publisher,
            reader,
            other,
            address,
            said,
            first: 0,
            part: 0,
            stall: Duration::from_millis(args.stall),
            ledger,
            proxy,
        };
        world.wait("the reader is there", |world| {
            guard(&world.ledger).is_ready()
        })?;
        Ok(world)
    }

    /// Taken and acknowledged samples, as the publisher says.
    fn said(&self) -> (u32, u32) {
        *guard(&self.said)
    }

    /// Lets the publisher write this many samples, until the time is over. Some are still under way
    /// afterwards.
    pub(super) fn write(&mut self, samples: u32, until: Instant) -> Result<(), Failure> {
        self.part = self.said().0.max(self.part);
        let target = self.part.saturating_add(samples);
        self.publisher.tell(&target.to_string())?;
        let patience = until + PATIENCE;
        loop {
            let (taken, _) = self.said();
            if taken >= target {
                return Ok(());
            }
            if Instant::now() > until && taken > self.part {
                return self.publisher.tell("0");
            }
            if Instant::now() > patience {
                return Err(Failure::refused("the publisher takes no samples"));
            }
            thread::sleep(Duration::from_millis(2));
        }
    }

    /// A fault, and its end.
    pub(super) fn suffer(&mut self, fault: Fault) -> Result<(), Failure> {
        match fault {
            Fault::Agent => {
                self.publisher.tell("0")?;
                let (_, acknowledged) = self.said();
                self.agent = None;
                thread::sleep(Duration::from_millis(300));
                guard(&self.ledger).mark();
                let back = Instant::now();
                self.agent = Some(start_agent(self.address)?);
                self.publisher.tell(&(self.said().0 + 50).to_string())?;
                self.wait("the reader is back", |world| {
                    guard(&world.ledger).longest() > Duration::ZERO
                })?;
                if back.elapsed() > RECOVERY {
                    let range = acknowledged..self.said().0.saturating_add(UNSAID);
                    guard(&self.ledger).excuse(range);
                }
            }
            Fault::Publisher => {
                let (taken, acknowledged) = self.said();
                guard(&self.ledger).acknowledge(self.first..acknowledged.max(self.first));
                self.first = taken + UNSAID;
                self.part = self.first;
                *guard(&self.said) = (self.first, self.first);
                self.publisher = start_publisher(&self.proxy, &self.said, self.first)?;
            }
            Fault::Reader => self.other = other_reader(&self.proxy)?,
            Fault::Stall => {
                self.reader.stop(true)?;
                thread::sleep(self.stall);
                self.reader.stop(false)?;
            }
        }
        Ok(())
    }

    /// Waits until everything that was taken is acknowledged, and has arrived.
    pub(super) fn catch_up(&mut self) -> Result<(), Failure> {
        self.wait("all have caught up", |world| {
            let (taken, acknowledged) = world.said();
            taken == acknowledged && guard(&world.ledger).has(world.part.max(world.first)..taken)
        })
    }

    /// Enters the acknowledgements that the last publisher knows of.
    pub(super) fn end(&mut self) {
        let (_, acknowledged) = self.said();
        guard(&self.ledger).acknowledge(self.first..acknowledged.max(self.first));
    }

    fn wait(&self, what: &str, done: impl Fn(&Self) -> bool) -> Result<(), Failure> {
        let until = Instant::now() + PATIENCE;
        while !done(self) {
            if Instant::now() > until {
                let (said, verdict) = (self.said(), guard(&self.ledger).verdict());
                return Err(Failure::refused(format!(
                    "not within {} s: {what} (taken and acknowledged {said:?}; {verdict:?})",
                    PATIENCE.as_secs()
                )));
            }
            thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }
}

fn part(name: &str, at: SocketAddr, key: u8, first: u32) -> Result<Process, Failure> {
    let words = ["bench", "soak"].map(String::from);
    let options = [
        format!("--part={name}"),
        format!("--at={at}"),
        format!("--key={key}"),
        format!("--first={first}"),
    ];
    Process::start(&[&words[..], &options].concat())
}

fn start_publisher(proxy: &Proxy, said: &Said, first: u32) -> Result<Process, Failure> {
    let mut publisher = part("publisher", proxy.address, 3, first)?;
    let (output, said) = (publisher.output()?, Arc::clone(said));
    thread::spawn(move || {
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            let mut numbers = line.split(' ').map(str::parse);
            if let (Some(Ok(taken)), Some(Ok(acknowledged))) = (numbers.next(), numbers.next()) {
                let mut said = guard(&said);
                // A line of the publisher before may come late.
                if taken >= first && taken >= said.0 {
                    *said = (taken, acknowledged);
                }
            }
        }
    });
    Ok(publisher)
}

fn other_reader(proxy: &Proxy) -> Result<Process, Failure> {
    let mut reader = part("reader", proxy.address, 2, 0)?;
    let output = reader.output()?;
    thread::spawn(move || read(output, &mut |_| ()));
    Ok(reader)
}

/// Reads the numbers of a reader until it ends.
fn read(output: ChildStdout, got: &mut dyn FnMut(u32)) {
    let mut output = BufReader::new(output);
    let mut number = [0; 4];
    while output.read_exact(&mut number).is_ok() {
        got(u32::from_le_bytes(number));
    }
}

/// Starts an agent, and waits until it answers.
fn start_agent(address: SocketAddr) -> Result<Process, Failure> {
    let options = [
        format!("--udp={address}"),
        "--supervised".into(),
        "--ordinary".into(),
        "--strangers-rate=0".into(),
    ];
    let agent = Process::start(&[&["agent".to_string()], &options[..]].concat())?;
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(system)?;
    let look = Some(Duration::from_millis(20));
    socket.set_read_timeout(look).map_err(system)?;
    let until = Instant::now() + PATIENCE;
    let request = RequestId(11);
    while Instant::now() < until {
        let (mut question, mut answer) = ([0; 64], [0; 64]);
        let question = client::ping(request, None, &mut question).map_err(Failure::refused)?;
        if socket.send_to(question, address).is_err() {
            continue;
        }
        match socket.recv(&mut answer) {
            Ok(len) if client::pong(request, answer.get(..len).unwrap_or_default()).is_some() => {
                return Ok(agent);
            }
            _ => thread::sleep(Duration::from_millis(5)),
        }
    }
    Err(Failure::refused("the agent does not answer"))
}
