//! A bad link: a UDP proxy between clients and agent that loses, repeats, delays and damages.
//!
//! ```text
//!   clients ◄──► front ─► fates ─► delayed ─► a socket per client ◄──► agent
//! ```
//!
//! A datagram with a flipped bit is dropped: UDP's checksum, which loopback does not compute, finds
//! every single bit.

use super::options::Args;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};
use std::{io, thread};

/// Time between two looks of a waiting thread at its end.
const LOOK: Duration = Duration::from_millis(100);

/// Clients; each has a socket. The soak has five.
const MOST: usize = 64;

/// Datagrams by their fate.
#[derive(Debug, Default, serde::Serialize)]
pub(super) struct Counts {
    pub(super) passed: AtomicU64,
    pub(super) lost: AtomicU64,
    pub(super) repeated: AtomicU64,
    pub(super) damaged: AtomicU64,
}

/// The proxy. Dropping it ends its threads.
#[derive(Debug)]
pub(super) struct Proxy {
    pub(super) address: SocketAddr,
    pub(super) counts: Arc<Counts>,
    end: Arc<AtomicBool>,
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
    }
}

/// A datagram under way, by its time.
struct Delayed {
    at: Instant,
    order: u64,
    by: Arc<UdpSocket>,
    to: SocketAddr,
    bytes: Vec<u8>,
}

/// One direction's fates.
struct Fates {
    random: u64,
    loss: u64,
    counts: Arc<Counts>,
    line: Sender<Delayed>,
}

impl Proxy {
    /// Starts it before an agent.
    pub(super) fn start(agent: SocketAddr, args: &Args) -> io::Result<Self> {
        let front = Arc::new(UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?);
        let proxy = Self {
            address: front.local_addr()?,
            counts: Arc::default(),
            end: Arc::default(),
        };
        let (line, delayed) = mpsc::channel();
        thread::spawn(move || deliver(&delayed));
        let (counts, end) = (Arc::clone(&proxy.counts), Arc::clone(&proxy.end));
        let (seed, loss) = (args.seed, u64::from(args.loss) * 10);
        let fates = move |direction: u64| Fates {
            random: (seed ^ direction << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1,
            loss,
            counts: Arc::clone(&counts),
            line: line.clone(),
        };
        thread::spawn(move || from_clients(&front, agent, &fates, &end));
        Ok(proxy)
    }
}

/// Client by client, to the agent; and for each a thread for the other direction.
fn from_clients(
    front: &Arc<UdpSocket>,
    agent: SocketAddr,
    fates: &dyn Fn(u64) -> Fates,
    end: &Arc<AtomicBool>,
) {
    let mut sockets = HashMap::<SocketAddr, Arc<UdpSocket>>::new();
    let mut up = fates(0);
    front.set_read_timeout(Some(LOOK)).ok();
    let mut buf = [0; 65_536];
    while !end.load(Ordering::Relaxed) {
        let Ok((len, client)) = front.recv_from(&mut buf) else {
            continue;
        };
        if !sockets.contains_key(&client) && sockets.len() < MOST {
            let Ok(socket) = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map(Arc::new) else {
                continue;
            };
            sockets.insert(client, Arc::clone(&socket));
            let (front, end) = (Arc::clone(front), Arc::clone(end));
            let mut down = fates(sockets.len() as u64);
            thread::spawn(move || {
                socket.set_read_timeout(Some(LOOK)).ok();
                let mut buf = [0; 65_536];
                while !end.load(Ordering::Relaxed) {
                    match socket.recv_from(&mut buf) {
                        Ok((len, from)) if from == agent => down.meet(&front, client, &buf[..len]),
                        _ => {}
                    }
                }
            });
        }
        if let Some(socket) = sockets.get(&client) {
            up.meet(socket, agent, buf.get(..len).unwrap_or_default());
        }
    }
}

impl Fates {
    /// xorshift64*.
    fn draw(&mut self, below: u64) -> u64 {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        (self.random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16) % below
    }

    fn meet(&mut self, by: &Arc<UdpSocket>, to: SocketAddr, bytes: &[u8]) {
        let (loss, damage, repeat) = (self.draw(1000), self.draw(1000), self.draw(1000));
        let copies = if loss < self.loss {
            self.counts.lost.fetch_add(1, Ordering::Relaxed);
            0
        } else if damage < 20 {
            self.counts.damaged.fetch_add(1, Ordering::Relaxed);
            0
        } else {
            self.counts.passed.fetch_add(1, Ordering::Relaxed);
            1 + u64::from(repeat < 50)
        };
        if copies == 2 {
            self.counts.repeated.fetch_add(1, Ordering::Relaxed);
        }
        for _ in 0..copies {
            // Half a millisecond to three: so they overtake each other.
            let delay = Duration::from_micros(500 + self.draw(2500));
            let delayed = Delayed {
                at: Instant::now() + delay,
                order: self.random,
                by: Arc::clone(by),
                to,
                bytes: bytes.to_vec(),
            };
            self.line.send(delayed).ok(); // the proxy ends
        }
    }
}

/// Sends each datagram when its time has come; ends with the last sender.
fn deliver(line: &Receiver<Delayed>) {
    let mut waiting = BinaryHeap::<Reverse<Delayed>>::new();
    loop {
        let now = Instant::now();
        while waiting.peek().is_some_and(|Reverse(first)| first.at <= now) {
            if let Some(Reverse(first)) = waiting.pop() {
                // The receiver may be gone: then it is lost.
                first.by.send_to(&first.bytes, first.to).ok();
            }
        }
        let next = waiting.peek().map(|Reverse(first)| first.at);
        let limit = next.map_or(LOOK, |at| at.saturating_duration_since(now));
        match line.recv_timeout(limit) {
            Ok(delayed) => waiting.push(Reverse(delayed)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

impl PartialEq for Delayed {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Delayed {}

impl PartialOrd for Delayed {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Delayed {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.order).cmp(&(other.at, other.order))
    }
}
