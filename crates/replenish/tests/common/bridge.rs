//! Bridges between a byte stream and a UDP agent: TCP with lengths, or a pseudo-terminal with the
//! stock framing.

use replenish_os::tty::Pty;
use replenish_testkit::alloc::exempt_this_thread;
use replenish_xrce::framing::{
    Prefixed, SERIAL_AGENT, SERIAL_CLIENT, Serial, prefix, serial_frame, serial_frame_len,
};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

fn agent_socket(agent: SocketAddr) -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(agent).unwrap();
    socket.set_nonblocking(true).unwrap();
    socket
}

/// Damage to bytes: at random, because repetitions may come at any regular distance.
struct Noise(u64);

impl Noise {
    fn harm(&mut self, bytes: &mut [u8], every: u64) {
        for byte in bytes {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695);
            if every > 0 && (self.0 >> 33).is_multiple_of(every) {
                *byte ^= 0x14;
            }
        }
    }
}

/// Stops and is joined when it is dropped.
pub struct Bridge {
    stop: Arc<AtomicBool>,
    cut: Arc<AtomicBool>,
    damage: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Bridge {
    /// A TCP agent at the address it returns; one connection at a time.
    pub fn tcp(agent: SocketAddr) -> (Self, SocketAddr) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        listener.set_nonblocking(true).unwrap();
        let bridge = Self::spawn(move |stop, cut, _| {
            while !stop.load(Ordering::SeqCst) {
                match listener.accept() {
                    Ok((stream, _)) => tcp(&stream, agent, stop, cut),
                    Err(_) => std::thread::sleep(Duration::from_millis(1)),
                }
            }
        });
        (bridge, address)
    }

    /// An agent at the other end of the terminal it returns.
    pub fn pty(agent: SocketAddr) -> (Self, PathBuf) {
        let pty = Pty::open().unwrap();
        let path = pty.path().to_path_buf();
        let bridge = Self::spawn(move |stop, _, damage| {
            let socket = agent_socket(agent);
            let mut decoder = Serial::new(SERIAL_AGENT, vec![0; 1024]);
            let (mut bytes, mut frame) = ([0; 512], vec![0; serial_frame_len(1024)]);
            let mut noise = Noise(1);
            while !stop.load(Ordering::SeqCst) {
                let every = damage.load(Ordering::SeqCst);
                let mut harm = |bytes: &mut [u8]| noise.harm(bytes, every);
                if let Ok(len) = pty.tty.read(&mut bytes) {
                    harm(&mut bytes[..len]);
                    decoder.push(&bytes[..len], |_, message| {
                        socket.send(message).ok();
                    });
                }
                if let Ok(len) = socket.recv(&mut bytes) {
                    let message = bytes[..len].to_vec();
                    let len =
                        serial_frame(SERIAL_AGENT, SERIAL_CLIENT, &message, &mut frame).unwrap();
                    harm(&mut frame[..len]);
                    let mut rest = &frame[..len];
                    while !rest.is_empty() && !stop.load(Ordering::SeqCst) {
                        rest = &rest[pty.tty.write(rest).unwrap_or(0)..];
                    }
                } else {
                    std::thread::sleep(Duration::from_micros(200));
                }
            }
        });
        (bridge, path)
    }

    /// A line of `baud` bits per second between the two terminals it returns; the damage is done to
    /// both directions together.
    pub fn line(baud: u32) -> (Self, PathBuf, PathBuf) {
        let (left, right) = (Pty::open().unwrap(), Pty::open().unwrap());
        let paths = (left.path().to_path_buf(), right.path().to_path_buf());
        let bridge = Self::spawn(move |stop, _, damage| {
            let start = Instant::now();
            let (mut passed, mut noise) = ([0_u64; 2], Noise(2));
            let mut bytes = [0; 64];
            while !stop.load(Ordering::SeqCst) {
                let every = damage.load(Ordering::SeqCst);
                let micros = u64::try_from(start.elapsed().as_micros()).unwrap();
                let allowed = micros * u64::from(baud) / 10_000_000;
                for (way, passed) in passed.iter_mut().enumerate() {
                    let (from, to) = if way == 0 {
                        (&left, &right)
                    } else {
                        (&right, &left)
                    };
                    // Capacity of the line while there was nothing to carry is gone.
                    *passed = (*passed).max(allowed.saturating_sub(64));
                    let most = usize::try_from(allowed - *passed).unwrap().min(64);
                    let Ok(len @ 1..) = from.tty.read(&mut bytes[..most]) else {
                        continue;
                    };
                    *passed += u64::try_from(len).unwrap();
                    noise.harm(&mut bytes[..len], every);
                    let mut rest = &bytes[..len];
                    while !rest.is_empty() && !stop.load(Ordering::SeqCst) {
                        rest = &rest[to.tty.write(rest).unwrap_or(0)..];
                    }
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        (bridge, paths.0, paths.1)
    }

    fn spawn(run: impl FnOnce(&AtomicBool, &AtomicBool, &AtomicU64) + Send + 'static) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let cut = Arc::new(AtomicBool::new(false));
        let damage = Arc::new(AtomicU64::new(0));
        let theirs = (Arc::clone(&stop), Arc::clone(&cut), Arc::clone(&damage));
        let thread = std::thread::spawn(move || {
            exempt_this_thread();
            run(&theirs.0, &theirs.1, &theirs.2);
        });
        Bridge {
            stop,
            cut,
            damage,
            thread: Some(thread),
        }
    }

    /// Closes the connection there is.
    pub fn cut(&self) {
        self.cut.store(true, Ordering::SeqCst);
    }

    /// Changes one byte in `every` on the average; 0 for none.
    pub fn damage(&self, every: u64) {
        self.damage.store(every, Ordering::SeqCst);
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn tcp(mut stream: &TcpStream, agent: SocketAddr, stop: &AtomicBool, cut: &AtomicBool) {
    stream.set_nonblocking(true).unwrap();
    stream.set_nodelay(true).unwrap();
    let socket = agent_socket(agent);
    let mut decoder = Prefixed::new(vec![0; 1024]);
    let mut bytes = [0; 1024];
    while !stop.load(Ordering::SeqCst) && !cut.swap(false, Ordering::SeqCst) {
        let mut idle = true;
        match stream.read(&mut bytes) {
            Ok(0) => return,
            Ok(len) => {
                idle = false;
                decoder.push(&bytes[..len], |message| {
                    socket.send(message).ok();
                });
            }
            Err(_) => {}
        }
        if let Ok(len) = socket.recv(&mut bytes) {
            idle = false;
            let mut whole = prefix(len).unwrap().to_vec();
            whole.extend(&bytes[..len]);
            let mut rest = &whole[..];
            while !rest.is_empty() {
                match stream.write(rest) {
                    Ok(len) => rest = &rest[len..],
                    Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {}
                    Err(_) => return,
                }
            }
        }
        if idle {
            std::thread::sleep(Duration::from_micros(200));
        }
    }
}
