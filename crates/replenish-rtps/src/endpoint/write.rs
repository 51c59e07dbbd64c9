//! The limits of a writer, the head of a sample that it writes, and its refusals.

use crate::wire::{ChainOrigins, GuidPrefix, Locators, SampleIdentity, SharedPlace, Timestamp};
use core::net::SocketAddr;

/// The memory and the messages of a writer.
#[derive(Clone, Copy, Debug)]
pub struct WriterLimits {
    /// Samples that are kept, from 1. For [`Qos`](crate::wire::Qos) that keeps the last ones, its
    /// depth.
    pub samples: usize,
    /// Bytes of the longest sample with its encapsulation, from 4.
    pub sample_bytes: usize,
    /// Matched readers, from 1.
    pub readers: usize,
    /// Bytes of a fragment, 64 to 65 000. Longer samples are cut.
    pub fragment_bytes: u16,
    /// Bytes of all samples together, at least one sample's: memory is then taken with each of
    /// them. `None`: all of it is taken when the writer is made.
    pub memory: Option<usize>,
    /// Readers on this host.
    pub host: HostLimits,
}

/// How samples go to readers of this library on the same host, where each datagram has its cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostLimits {
    /// Bytes of a fragment, 64 to 65 000.
    pub fragment_bytes: u16,
    /// Bytes that are sent at once: they wait in the reader's socket.
    pub burst: usize,
    /// The addresses of this host besides those of loopback.
    pub addresses: Locators,
}

impl HostLimits {
    /// Nothing but loopback, short bursts.
    pub const DEFAULT: Self = HostLimits {
        fragment_bytes: 64_000,
        burst: 128_000,
        addresses: Locators::NONE,
    };

    pub(super) fn has(&self, to: SocketAddr) -> bool {
        let own = |addr: SocketAddr| addr.ip() == to.ip();
        to.ip().is_loopback() || self.addresses.iter().any(own)
    }
}

/// The data that is sent along with a sample's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// The time that it bears, of the wall clock.
    pub source: Option<Timestamp>,
    /// The request that it belongs to: sent along with it.
    pub related: Option<SampleIdentity>,
    /// The chains that led to it: sent along if it belongs to no request.
    pub origins: ChainOrigins,
    /// The participant whose readers alone get it, also those that are matched later; `None`: all.
    pub only: Option<GuidPrefix>,
    /// The place in memory that the writer shares, which has the same bytes for as long as the
    /// writer keeps the sample: readers that can fetch them get a reference.
    pub shared: Option<SharedPlace>,
}

/// Reason why a sample was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WriteError {
    /// The sample is longer than the writer's limit.
    TooLong {
        /// Its bytes, with the encapsulation.
        len: usize,
        /// The limit, [`WriterLimits::sample_bytes`].
        most: usize,
    },
    /// All samples are to be kept, and a reader lacks the oldest.
    Full,
    /// There is no such writer.
    NoWriter,
}

impl core::fmt::Display for WriteError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            WriteError::TooLong { len, most } => {
                write!(f, "a sample of {len} bytes: the writer's limit is {most}")
            }
            WriteError::Full => f.write_str("the history is full of samples that a reader lacks"),
            WriteError::NoWriter => f.write_str("there is no such writer"),
        }
    }
}

impl core::error::Error for WriteError {}
