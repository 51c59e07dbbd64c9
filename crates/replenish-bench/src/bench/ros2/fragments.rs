//! Fragments of a long sample on their way to the kernel: sixteen in one call, and one by one.
//!
//! Both take turns. The receiving socket is emptied between bursts, and its time is not counted.

use super::encoding::on_cpu;
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::Failure;
use replenish_os::{clock, cut_datagrams};
use std::io;
use std::net::UdpSocket;

/// Bursts of each kind.
const BURSTS: usize = 300;
/// Datagrams of a burst, as many as the executor gives to the kernel together.
const TOGETHER: u16 = 16;
/// Bytes of a datagram to another host.
const BYTES: u16 = 1400;

/// CPU time of one datagram. The names are a contract: docs/schemas/bench-ros2.json.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct Fragments {
    pub(super) bytes: u16,
    /// Sixteen in one call.
    pub(super) together_us: f64,
    pub(super) alone_us: f64,
}

/// Measures on a thread of its own on `cpu`.
pub(super) fn measure(cpu: usize) -> Result<Fragments, Failure> {
    on_cpu(cpu, || bursts().map_err(Failure::refused))
}

fn bursts() -> io::Result<Fragments> {
    let [from, to] = [
        UdpSocket::bind("127.0.0.1:0")?,
        UdpSocket::bind("127.0.0.1:0")?,
    ];
    from.connect(to.local_addr()?)?;
    to.set_nonblocking(true)?;
    let burst = vec![7; usize::from(BYTES) * usize::from(TOGETHER)];
    let mut room = vec![0; usize::from(BYTES)];
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..BURSTS {
        for (kind, times) in times.iter_mut().enumerate() {
            let began = clock::thread_cpu();
            if kind == 0 {
                cut_datagrams(&from, BYTES)?;
                from.send(&burst)?;
                cut_datagrams(&from, 0)?;
            } else {
                for datagram in burst.chunks(usize::from(BYTES)) {
                    from.send(datagram)?;
                }
            }
            let each = (clock::thread_cpu() - began) / u64::from(TOGETHER);
            times.push(i64::try_from(each).unwrap_or(i64::MAX));
            while to.recv(&mut room).is_ok() {}
        }
    }
    let [together_us, alone_us] = times.map(|times| us(Sorted::new(times).median()));
    Ok(Fragments {
        bytes: BYTES,
        together_us,
        alone_us,
    })
}
