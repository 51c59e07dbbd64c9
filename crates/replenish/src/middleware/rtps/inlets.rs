//! [`Inlets`]: the sockets of readers, and which of all sockets the last wait found ready.

use crate::Nanos;
use crate::middleware::{Interest, ReaderId};
use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;
use replenish_os::{SocketSet, count_drops, receive_counted};
use std::io;
use std::net::UdpSocket;
use std::os::fd::BorrowedFd;

/// Keys of what is waited for: the waker, the alarm, the participant's four sockets, changes of the
/// host's addresses, and from here on the readers' sockets.
pub(super) const WAKER: u32 = 0;
pub(super) const ALARM: u32 = 1;
pub(super) const SHARED: u32 = 2;
pub(super) const NETWORK: u32 = SHARED + 4;
pub(super) const READERS: u32 = 8;

/// Datagrams of one socket that are taken before the next socket has its turn.
pub(super) const BATCH: usize = 16;
/// A wait that took so long has slept.
const SLEPT: Nanos = 10_000;

/// Belongs to the dispatcher, but for set-up. Never locked across a wait.
pub(super) struct Inlets {
    pub(super) buf: Box<[u8]>,
    /// By reader.
    readers: Vec<Option<UdpSocket>>,
    /// Readers whose sockets end a wait.
    polled: Interest,
    ready: [u32; SocketSet::MOST],
    count: usize,
    /// The participant's sockets, and that of changes, that do not end a wait.
    deaf: [bool; 5],
    /// When the last wait began.
    waited_from: Nanos,
}

impl Inlets {
    pub(super) fn new() -> Self {
        Self {
            buf: vec![0; 65_536].into_boxed_slice(),
            readers: Vec::new(),
            polled: Interest::empty(),
            ready: [0; SocketSet::MOST],
            count: 0,
            deaf: [false; 5],
            waited_from: 0,
        }
    }

    /// Adds a reader's socket, which nobody is interested in yet.
    pub(super) fn add(
        &mut self,
        set: &SocketSet,
        reader: ReaderId,
        socket: UdpSocket,
    ) -> io::Result<()> {
        count_drops(&socket)?;
        set.add(&socket, key(reader), false)?;
        let at = usize::from(reader.0);
        while self.readers.len() <= at {
            self.readers.push(None);
        }
        self.polled.remove(reader);
        if let Some(place) = self.readers.get_mut(at) {
            *place = Some(socket);
        }
        Ok(())
    }

    /// Closes a reader's socket, which leaves the set by that.
    pub(super) fn remove(&mut self, reader: ReaderId) {
        self.polled.remove(reader);
        if let Some(place) = self.readers.get_mut(usize::from(reader.0)) {
            *place = None;
        }
    }

    /// A reader's socket.
    pub(super) fn socket(&self, reader: ReaderId) -> Option<&UdpSocket> {
        self.readers.get(usize::from(reader.0))?.as_ref()
    }

    /// Gives a reader's socket away; `None`, and it stays, if it cannot leave the set.
    pub(super) fn give_away(&mut self, set: &SocketSet, reader: ReaderId) -> Option<UdpSocket> {
        set.remove(self.socket(reader)?).ok()?;
        self.polled.remove(reader);
        self.readers.get_mut(usize::from(reader.0))?.take()
    }

    /// From now on the sockets of these readers end a wait, and no other reader's.
    pub(super) fn follow(&mut self, set: &SocketSet, interest: &Interest) -> io::Result<()> {
        if self.polled == *interest {
            return Ok(());
        }
        for (at, socket) in (0..).zip(&self.readers) {
            let reader = ReaderId(at);
            let wanted = interest.contains(reader);
            let Some(socket) = socket else {
                continue;
            };
            if wanted != self.polled.contains(reader) {
                set.want(socket, key(reader), wanted)?;
            }
        }
        self.polled = *interest;
        Ok(())
    }

    /// A wait begins.
    pub(super) const fn begin_wait(&mut self, now: Nanos) {
        self.waited_from = now;
    }

    /// The datagrams that are taken from a socket, the first of which came before `now`. One alone
    /// ends most waits that sleep: asking for another one in vain costs more than waiting for it.
    pub(super) const fn batch(&self, now: Nanos) -> usize {
        let slept = self.waited_from != 0 && now.saturating_sub(self.waited_from) > SLEPT;
        if slept { 1 } else { BATCH }
    }

    /// Keeps what a wait has found.
    pub(super) fn found(&mut self, keys: &[u32; SocketSet::MOST], count: usize) {
        (self.ready, self.count) = (*keys, count);
    }

    /// From now on these sockets of the participant end a wait, but for those that are `deaf`:
    /// there is no CPU time left for what they hear.
    pub(super) fn follow_shared(
        &mut self,
        set: &SocketSet,
        sockets: [Option<BorrowedFd<'_>>; 5],
        deaf: [bool; 5],
    ) -> io::Result<()> {
        if self.deaf == deaf {
            return Ok(());
        }
        let changes = self.deaf.iter_mut().zip(deaf);
        for ((key, socket), (was, is)) in (SHARED..).zip(sockets).zip(changes) {
            if let Some(socket) = socket.filter(|_| *was != is) {
                set.want(&socket, key, !is)?;
            }
            *was = is;
        }
        Ok(())
    }

    /// Takes the next key that the last wait has found.
    pub(super) fn next_ready(&mut self) -> Option<u32> {
        self.count = self.count.checked_sub(1)?;
        self.ready.get(self.count).copied()
    }

    /// Receives from a reader's socket: bytes, and how many datagrams the kernel has dropped there.
    pub(super) fn receive(&mut self, reader: ReaderId) -> Option<(&[u8], Option<u32>)> {
        let socket = self.readers.get(usize::from(reader.0))?.as_ref()?;
        let datagram = receive_counted(socket, &mut self.buf).ok()?;
        Some((self.buf.get(..datagram.len)?, datagram.drops))
    }

    /// Receives from a socket of the participant.
    pub(super) fn receive_from(&mut self, socket: &UdpSocket) -> Option<&[u8]> {
        let len = replenish_os::receive(socket, &mut self.buf).ok()?;
        self.buf.get(..len)
    }
}

fn key(reader: ReaderId) -> u32 {
    READERS.saturating_add(reader.0.into())
}
