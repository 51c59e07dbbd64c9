//! [`UdpParticipant`]: a participant on UDP sockets, driven by the caller's own thread.
//!
//! ```text
//!   step ──► transmit until nothing is left ──► wait for a datagram or the next timer ──► receive
//!    ▲                                                                                       │
//!    └───────────────────────────────────────────────────────────────────────────────────────┘
//! ```
//!
//! No thread is made. After [`UdpParticipant::open`] only new endpoints allocate.

use super::config::{OpenError, UdpConfig};
use super::interfaces::Interfaces;
use super::sockets::Sockets;
use crate::participant::Participant;
use crate::wire::Nanos;
use core::time::Duration;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::{RecvFlags, recv};
use std::boxed::Box;
use std::io;
use std::net::UdpSocket;
use std::time::Instant;
use std::vec;

/// Datagrams of one socket that are taken before something is sent.
const BATCH: usize = 64;
/// A wait that took so long has slept: one datagram has ended it, and the next one is waited for
/// rather than asked for in vain.
const SLEPT: Nanos = 10_000;

/// Counts of the sockets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UdpStats {
    /// Datagrams that were received.
    pub received: u64,
    /// Of them those that were not RTPS, or damaged.
    pub malformed: u64,
    /// Datagrams that were sent.
    pub sent: u64,
    /// Datagrams that the kernel did not take.
    pub unsent: u64,
}

/// A participant and its sockets.
#[derive(Debug)]
pub struct UdpParticipant {
    participant: Participant,
    sockets: Sockets,
    interfaces: Interfaces,
    epoch: Instant,
    buf: Box<[u8]>,
    datagram: usize,
    stats: UdpStats,
}

impl UdpParticipant {
    /// Binds the sockets and makes the participant.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn open(config: &UdpConfig<'_>) -> Result<Self, OpenError> {
        let sockets = Sockets::open(config)?;
        let participant = sockets.participant(config, 0)?;
        Ok(UdpParticipant {
            participant,
            sockets,
            interfaces: config.used(),
            epoch: Instant::now(),
            buf: vec![0; 65_536].into_boxed_slice(),
            datagram: config.longest_datagram().min(65_536),
            stats: UdpStats::default(),
        })
    }

    /// The time for calls to the participant: nanoseconds since it was opened.
    #[must_use]
    pub fn now(&self) -> Nanos {
        u64::try_from(self.epoch.elapsed().as_nanos()).unwrap_or(Nanos::MAX)
    }

    /// The participant.
    #[must_use]
    pub const fn participant(&self) -> &Participant {
        &self.participant
    }

    /// The participant, to make endpoints, write and read.
    pub const fn participant_mut(&mut self) -> &mut Participant {
        &mut self.participant
    }

    /// From now on uses these interfaces; for those that [`UdpConfig::follows`] lets change.
    ///
    /// # Errors
    /// As [`Sockets::follow`].
    pub fn follow(&mut self, interfaces: &Interfaces) -> io::Result<()> {
        let now = self.now();
        let joined = self.sockets.follow(&self.interfaces, interfaces);
        self.interfaces = *interfaces;
        self.participant.move_to(&interfaces.at(0), now);
        while self.participant.announce_moved(now) {}
        joined
    }

    /// Counts of the sockets.
    #[must_use]
    pub const fn stats(&self) -> UdpStats {
        self.stats
    }

    /// Sends what is to be sent, waits at most `patience` for a datagram or a timer, and takes in
    /// what has arrived, at most 64 datagrams of each socket.
    ///
    /// # Errors
    /// The errors of `poll(2)`. An error of a single datagram is counted.
    pub fn step(&mut self, patience: Duration) -> io::Result<()> {
        let now = self.now();
        let due = self.send(now).saturating_sub(now);
        let wait = patience.min(Duration::from_nanos(due));
        let timeout = Timespec {
            tv_sec: i64::try_from(wait.as_secs()).unwrap_or(i64::MAX),
            tv_nsec: wait.subsec_nanos().into(),
        };
        // A socket that is not open is neither waited for nor ready.
        let fds = self.sockets.all();
        let flags = |fd: Option<&UdpSocket>| fd.map_or(PollFlags::empty(), |_| PollFlags::IN);
        let Some(any) = fds.into_iter().flatten().next() else {
            return Ok(());
        };
        let mut polled = fds.map(|fd| PollFd::new(fd.unwrap_or(any), flags(fd)));
        match poll(&mut polled, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        let ready = polled.map(|fd| fd.revents().contains(PollFlags::IN));
        let began = now;
        let now = self.now();
        let slept = now.saturating_sub(began) > SLEPT;
        let most = if slept { 1 } else { BATCH };
        for (at, ready) in ready.into_iter().enumerate() {
            if ready {
                self.receive(at, most, now);
            }
        }
        self.send(now);
        Ok(())
    }

    /// Takes in what waits at a socket, at most so many datagrams, as of `now`.
    fn receive(&mut self, at: usize, most: usize, now: Nanos) {
        for _ in 0..most {
            let socket = self.sockets.all().get(at).copied().flatten();
            let taken = socket.map(|fd| recv(fd, &mut *self.buf, RecvFlags::empty()));
            let Some(Ok((len, _))) = taken else {
                return;
            };
            self.stats.received += 1;
            let datagram = self.buf.get(..len).unwrap_or(&[]);
            let understood = self.participant.receive(datagram, now).is_ok();
            self.stats.malformed += u64::from(!understood);
        }
    }

    /// Sends what is due at `now`; when there is more to send.
    fn send(&mut self, now: Nanos) -> Nanos {
        loop {
            let next = self.participant.next_at(now);
            if next > now {
                return next;
            }
            let room = self.buf.get_mut(..self.datagram).unwrap_or_default();
            let Some((len, to)) = self.participant.transmit(room, now) else {
                return self.participant.next_at(now);
            };
            let datagram = self.buf.get(..len).unwrap_or(&[]);
            if self.sockets.send(datagram, to, &self.interfaces) {
                self.stats.sent += 1;
            } else {
                self.stats.unsent += 1;
            }
        }
    }
}

impl Drop for UdpParticipant {
    /// Says goodbye, so that peers need not wait for the lease to end.
    fn drop(&mut self) {
        let now = self.now();
        self.participant.leave(now);
        self.send(now);
    }
}
