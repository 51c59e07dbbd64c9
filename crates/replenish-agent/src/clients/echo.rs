//! Whether the address of a client receives anything: before it has shown that, little is sent.
//!
//! ```text
//!   log-in ──► awaited: 3 bytes for each from there ── ACKNACK of something that was sent ──► shown
//!                 └─ samples wait: asked by HEARTBEAT, again and again as far as the bytes go
//! ```
//!
//! The source of a UDP datagram can be forged. Without this a forged log-in makes the agent send a
//! topic's traffic to an address that never asked for it.

use replenish_xrce::Nanos;

/// The time between two HEARTBEATs that ask for an echo.
const ASK_AGAIN: Nanos = 50_000_000;

/// The agent's knowledge of a client's address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Echo {
    /// The client has shown nothing yet: this many bytes may leave for it.
    Awaited {
        /// Bytes.
        credit: usize,
        /// Time at which it may be asked.
        ask_at: Nanos,
        /// The client was asked.
        asked: bool,
    },
    /// The client has acknowledged something, or its transport is connected.
    Shown,
}

impl Echo {
    /// An address that nothing is known of, for which `credit` bytes may leave.
    pub(crate) const fn awaited(credit: usize) -> Self {
        Self::Awaited {
            credit,
            ask_at: 0,
            asked: false,
        }
    }

    pub(crate) const fn is_shown(&self) -> bool {
        matches!(self, Self::Shown)
    }

    /// Whether a datagram of `bytes` may leave.
    pub(crate) const fn admits(&self, bytes: usize) -> bool {
        match self {
            Self::Awaited { credit, .. } => *credit >= bytes,
            Self::Shown => true,
        }
    }

    /// Counts `bytes` that leave.
    pub(crate) const fn spend(&mut self, bytes: usize) {
        if let Self::Awaited { credit, .. } = self {
            *credit = credit.saturating_sub(bytes);
        }
    }

    /// The bytes that may leave; `None` without limit.
    pub(crate) const fn credit(&self) -> Option<usize> {
        match self {
            Self::Awaited { credit, .. } => Some(*credit),
            Self::Shown => None,
        }
    }

    /// States the bytes that may leave.
    pub(crate) const fn set_credit(&mut self, bytes: usize) {
        if let Self::Awaited { credit, .. } = self {
            *credit = bytes;
        }
    }

    /// Time at which the client may be asked for an echo, if there is none yet.
    pub(crate) const fn ask_at(&self) -> Option<Nanos> {
        match self {
            Self::Awaited { ask_at, .. } => Some(*ask_at),
            Self::Shown => None,
        }
    }

    /// Notes that the client is asked now.
    pub(crate) const fn ask(&mut self, now: Nanos) {
        if let Self::Awaited { ask_at, asked, .. } = self {
            *ask_at = now.saturating_add(ASK_AGAIN);
            *asked = true;
        }
    }

    /// An ACKNACK came; `progress`: it acknowledges a message that was sent.
    pub(crate) const fn answered(&mut self, progress: bool) {
        if let Self::Awaited { asked, .. } = self
            && (progress || *asked)
        {
            *self = Self::Shown;
        }
    }
}
