//! The contract of everything that carries messages to an agent.

use crate::Nanos;
use crate::platform::io;
use core::fmt::Debug;
pub use replenish_xrce::Sent;

/// The result of a look at the transport's input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received {
    /// Nothing was there.
    Nothing,
    /// Something was; there may be more.
    Something,
    /// Something was, and that was all.
    All,
    /// The connection has ended. The next message sent opens a new one, if that can be.
    Closed,
}

/// Carries whole messages to an agent and from it, unreliably: what is lost, the session repairs.
///
/// No method waits. `send` is called by any thread, by one at a time and with the session's lock
/// held; `receive` and `with_descriptor` by any thread. After set-up nothing may be allocated.
pub trait Transport: Send + Sync + Debug + 'static {
    /// Hands over a message. It is called when [`ready_at`](Self::ready_at) has passed.
    ///
    /// # Errors
    /// The system's errors, except for those that [`Sent`] names.
    fn send(&self, now: Nanos, message: &[u8]) -> io::Result<Sent>;

    /// When the next message can be handed over; `Nanos::MAX` while only the descriptor can tell.
    /// Messages wait in the session until then, so that urgent ones overtake.
    fn ready_at(&self) -> Nanos {
        0
    }

    /// Whether the wait must also end when the descriptor can be written.
    fn wants_write(&self) -> bool {
        false
    }

    /// Reads once, and calls `deliver` with every message that is whole then. Also goes on with
    /// what could not be written at once.
    ///
    /// # Errors
    /// The system's errors, except for "nothing there" and the end of a connection.
    fn receive(&self, deliver: &mut dyn FnMut(&[u8])) -> io::Result<Received>;

    /// The descriptor that is readable when there is something to receive, if it is the same for
    /// as long as the transport lives and never has to be [writable](Self::wants_write): then
    /// waiting costs less than with [`with_descriptor`](Self::with_descriptor).
    #[cfg(feature = "std")]
    fn lasting_descriptor(&self) -> Option<std::os::fd::BorrowedFd<'_>> {
        None
    }

    /// Calls `wait` once with the descriptor that is readable when there is something to receive;
    /// `None` while there is no connection. The descriptor stays open until `wait` returns.
    #[cfg(feature = "std")]
    fn with_descriptor(&self, wait: &mut dyn FnMut(Option<std::os::fd::BorrowedFd<'_>>));

    /// The bell to ring, from then on, when there is something to receive and when messages can be
    /// sent again after [`wants_write`](Self::wants_write). Called once, at set-up.
    #[cfg(not(feature = "std"))]
    fn attach(&self, bell: &crate::sync::Arc<crate::sync::Notify>);
}
