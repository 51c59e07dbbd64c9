//! A UDP relay between clients and an agent that loses datagrams: some of them, or all of them.

use replenish_testkit::alloc::exempt_this_thread;
use std::collections::HashMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    percent: AtomicU32,
    lost: AtomicU64,
}

/// Stops and is joined when it is dropped.
pub struct Relay {
    pub address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Relays to `agent`; loses nothing yet.
    pub fn start(agent: SocketAddr) -> Self {
        let front = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (address, shared) = (front.local_addr().unwrap(), Arc::new(Shared::default()));
        let theirs = Arc::clone(&shared);
        let thread = Some(std::thread::spawn(move || run(&front, agent, &theirs)));
        Relay {
            address,
            shared,
            thread,
        }
    }

    /// Loses `percent` percent of the datagrams of either direction from now on.
    pub fn lose(&self, percent: u32) {
        self.shared.percent.store(percent, Ordering::SeqCst);
    }

    /// Datagrams lost so far.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.shared.lost.load(Ordering::SeqCst)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::SeqCst);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn run(front: &UdpSocket, agent: SocketAddr, shared: &Shared) {
    exempt_this_thread();
    front.set_nonblocking(true).unwrap();
    let mut backs: HashMap<SocketAddr, UdpSocket> = HashMap::new();
    let (mut buf, mut random) = ([0; 65_536], 1_u64);
    let mut keep = || {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let kept = (random >> 33) % 100 >= u64::from(shared.percent.load(Ordering::SeqCst));
        shared.lost.fetch_add(u64::from(!kept), Ordering::SeqCst);
        kept
    };
    while !shared.stop.load(Ordering::SeqCst) {
        let mut idle = true;
        if let Ok((len, client)) = front.recv_from(&mut buf) {
            idle = false;
            let back = backs.entry(client).or_insert_with(|| {
                let back = UdpSocket::bind("127.0.0.1:0").unwrap();
                back.connect(agent).unwrap();
                back.set_nonblocking(true).unwrap();
                back
            });
            if keep() {
                back.send(&buf[..len]).ok();
            }
        }
        for (client, back) in &backs {
            match back.recv(&mut buf) {
                Ok(len) => {
                    idle = false;
                    if keep() {
                        front.send_to(&buf[..len], client).ok();
                    }
                }
                Err(e) => assert!(
                    matches!(
                        e.kind(),
                        ErrorKind::WouldBlock | ErrorKind::ConnectionRefused
                    ),
                    "{e}"
                ),
            }
        }
        if idle {
            std::thread::sleep(Duration::from_micros(100));
        }
    }
}
