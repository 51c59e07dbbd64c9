//! Relays between client and agent that keep all bytes, and may lose, double and reorder datagrams.

use std::collections::HashMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// The fate of the `n`-th datagram of handshakes; those of messages pass.
pub(crate) type Fate = fn(n: u64) -> What;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum What {
    Pass,
    Lose,
    Twice,
    /// Goes after the next one.
    Later,
}

/// Stops and is joined when it is dropped.
pub(crate) struct Relay {
    pub(crate) address: SocketAddr,
    bytes: Arc<Mutex<Vec<u8>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<u64>>,
}

impl Relay {
    pub(crate) fn udp(agent: SocketAddr, fate: Fate) -> Self {
        let front = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = front.local_addr().unwrap();
        front.set_nonblocking(true).unwrap();
        Self::start(address, move |stop, bytes| {
            datagrams(&front, agent, fate, stop, bytes)
        })
    }

    pub(crate) fn tcp(agent: SocketAddr) -> Self {
        let front = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = front.local_addr().unwrap();
        front.set_nonblocking(true).unwrap();
        Self::start(address, move |stop, bytes| {
            connections(&front, agent, stop, bytes)
        })
    }

    fn start(
        address: SocketAddr,
        run: impl FnOnce(&AtomicBool, &Mutex<Vec<u8>>) -> u64 + Send + 'static,
    ) -> Self {
        let (bytes, stop) = (Arc::default(), Arc::default());
        let (to, until) = (Arc::clone(&bytes), Arc::clone(&stop));
        Self {
            address,
            bytes,
            stop,
            thread: Some(std::thread::spawn(move || run(&until, &to))),
        }
    }

    /// Number of bytes that passed, and whether `text` is among them.
    pub(crate) fn seen(&self, text: &[u8]) -> (usize, bool) {
        let bytes = self.bytes.lock().unwrap();
        let found = bytes.windows(text.len()).any(|part| part == text);
        (bytes.len(), found)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        let passed = self.thread.take().unwrap().join();
        assert!(passed.is_ok() || std::thread::panicking());
    }
}

fn datagrams(
    front: &UdpSocket,
    agent: SocketAddr,
    fate: Fate,
    stop: &AtomicBool,
    bytes: &Mutex<Vec<u8>>,
) -> u64 {
    let mut backs: HashMap<SocketAddr, UdpSocket> = HashMap::new();
    let (mut buf, mut count) = (vec![0; 65_535], 0);
    let mut later: Vec<(Option<SocketAddr>, SocketAddr, Vec<u8>)> = Vec::new();
    while !stop.load(Ordering::SeqCst) {
        let mut arrived = Vec::new();
        while let Ok((len, from)) = front.recv_from(&mut buf) {
            backs.entry(from).or_insert_with(|| {
                let back = UdpSocket::bind("127.0.0.1:0").unwrap();
                back.connect(agent).unwrap();
                back.set_nonblocking(true).unwrap();
                back
            });
            arrived.push((None, from, buf[..len].to_vec()));
        }
        for (client, back) in &backs {
            while let Ok(len) = back.recv(&mut buf) {
                arrived.push((Some(*client), *client, buf[..len].to_vec()));
            }
        }
        let idle = arrived.is_empty();
        let mut out = Vec::new();
        for datagram in arrived {
            bytes.lock().unwrap().extend(&datagram.2);
            // Application data has the type 23; a plain message begins with its session.
            let handshake = (20..23).contains(&datagram.2[0]);
            count += u64::from(handshake);
            let fate = if handshake { fate(count) } else { What::Pass };
            match fate {
                What::Pass => out.push(datagram),
                What::Lose => {}
                What::Twice => out.extend([datagram.clone(), datagram]),
                What::Later => {
                    later.push(datagram);
                    continue;
                }
            }
            out.append(&mut later);
        }
        for (to_client, client, datagram) in out {
            match to_client {
                Some(to) => drop(front.send_to(&datagram, to)),
                None => drop(backs[&client].send(&datagram)),
            }
        }
        if idle {
            std::thread::sleep(Duration::from_micros(200));
        }
    }
    count
}

fn connections(
    front: &TcpListener,
    agent: SocketAddr,
    stop: &AtomicBool,
    bytes: &Mutex<Vec<u8>>,
) -> u64 {
    let mut pairs: Vec<[TcpStream; 2]> = Vec::new();
    let (mut buf, mut count) = (vec![0; 65_535], 0);
    while !stop.load(Ordering::SeqCst) {
        if let Ok((client, _)) = front.accept() {
            let back = TcpStream::connect(agent).unwrap();
            for stream in [&client, &back] {
                stream.set_nonblocking(true).unwrap();
                stream.set_nodelay(true).unwrap();
            }
            pairs.push([client, back]);
        }
        for [a, b] in &pairs {
            for (mut from, mut to) in [(a, b), (b, a)] {
                match from.read(&mut buf) {
                    Ok(0) => drop(to.shutdown(Shutdown::Write)),
                    Ok(len) => {
                        count += 1;
                        bytes.lock().unwrap().extend(&buf[..len]);
                        let mut rest = &buf[..len];
                        while !rest.is_empty() {
                            match to.write(rest) {
                                Ok(len) => rest = &rest[len..],
                                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                                    std::thread::sleep(Duration::from_micros(100));
                                }
                                Err(_) => break,
                            }
                        }
                    }
                    Err(_) => {}
                }
            }
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    count
}
