//! The baselines: threads that receive datagrams and note when they came.

use super::receiver::{Received, Receiver, Setting};
use super::threads::{self, Used};
use crate::load::Nanos;
use crate::load::spec::HIGH_PRIORITY;
use replenish_cli::machine::fifo_or_other;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::{Thread, ThreadSpec, Tid, WaitSet, WakeFd, clock, spawn};
use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Arc;

/// As long as the agent's message with the same number in it: header, submessage, base, CDR, value.
const LENGTH: usize = 4 + 4 + 4 + 4 + 8;

/// A receiving loop: it gives each datagram to the function until that returns false.
pub(super) type Loop = fn(&UdpSocket, &mut dyn FnMut(&[u8]) -> bool) -> io::Result<()>;

/// Receives with one system call per message; nothing else can wake it.
pub(super) fn receives(
    socket: &UdpSocket,
    deliver: &mut dyn FnMut(&[u8]) -> bool,
) -> io::Result<()> {
    let mut buf = [0; 2048];
    loop {
        let len = socket.recv(&mut buf)?;
        if !deliver(buf.get(..len).unwrap_or_default()) {
            return Ok(());
        }
    }
}

/// Two system calls per message: others can wake it, too, and do not.
pub(super) fn waits_and_receives(
    socket: &UdpSocket,
    deliver: &mut dyn FnMut(&[u8]) -> bool,
) -> io::Result<()> {
    let (set, waker) = (WaitSet::new()?, WakeFd::new()?);
    set.add(socket, 1)?;
    set.add(&waker, 2)?;
    let mut buf = [0; 2048];
    loop {
        set.wait(None)?;
        let len = replenish_os::receive(socket, &mut buf)?;
        if !deliver(buf.get(..len).unwrap_or_default()) {
            return Ok(());
        }
    }
}

/// The raw loop and the way to it.
pub(super) struct Raw {
    to: UdpSocket,
    received: Arc<Received>,
    thread: Thread<Outcome>,
    tids: [Tid; 1],
}

impl Raw {
    pub(super) fn start(setting: Setting, by: Loop) -> Result<Self, Failure> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::refused)?;
        let to = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(Failure::refused)?;
        let address = socket.local_addr().map_err(Failure::refused)?;
        to.connect(address).map_err(Failure::refused)?;
        let received = Arc::new(Received::new(setting.rate));
        let notes = Arc::clone(&received);
        let body = move || {
            let mut deliver = |message: &[u8]| {
                let sent = message.last_chunk(); // an empty datagram ends it
                sent.inspect(|sent| notes.note(Nanos::from_le_bytes(**sent)))
                    .is_some()
            };
            by(&socket, &mut deliver).map_err(Failure::refused)
        };
        let policy = fifo_or_other(HIGH_PRIORITY);
        let spec = ThreadSpec::new("raw-loop").policy(policy).cpu(setting.cpu);
        let thread = spawn(spec, body).map_err(Failure::refused)?;
        let tids = [thread.tid()];
        Ok(Self {
            to,
            received,
            thread,
            tids,
        })
    }

    pub(super) fn stop(self) -> Outcome {
        self.to.send(&[]).map_err(Failure::refused)?;
        let ended = self.thread.join();
        ended.map_err(|_| Failure::refused("the raw loop panicked"))?
    }
}

impl Receiver for Raw {
    fn send(&mut self, _: u64) -> Outcome {
        let mut message = [0; LENGTH];
        if let Some(end) = message.last_chunk_mut() {
            *end = clock::monotonic().to_le_bytes();
        }
        self.to.send(&message).map(drop).map_err(Failure::refused)
    }

    fn received(&self) -> &Received {
        &self.received
    }

    fn used(&self) -> Result<Used, Failure> {
        threads::used(&self.tids)
    }
}
