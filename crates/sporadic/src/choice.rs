//! One of the servers, chosen at run time.

#[cfg(feature = "posix")]
use crate::Posix;
use crate::{BudgetServer, Corrected, Level, Nanos, ParamError, Params};

/// The kind of a budget server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Kind {
    /// [`Corrected`], the default.
    #[default]
    Corrected,
    /// [`Posix`](crate::Posix).
    #[cfg(feature = "posix")]
    Posix,
}

/// One of the servers, chosen at run time, with room for `N` pending replenishments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Server<const N: usize> {
    /// The corrected sporadic server.
    Corrected(Corrected<N>),
    /// The sporadic server of POSIX.
    #[cfg(feature = "posix")]
    Posix(Posix<N>),
}

impl<const N: usize> Server<N> {
    /// A server with its full budget at `now`, for a thread that is waiting.
    ///
    /// # Errors
    /// [`ParamError::MaxRepl`] if `max_repl` is above the capacity `N`.
    pub const fn new(kind: Kind, params: Params, now: Nanos) -> Result<Self, ParamError> {
        match params.check_capacity(N) {
            Ok(()) => Ok(Self::clamped(kind, params, now)),
            Err(error) => Err(error),
        }
    }

    /// See [`Corrected::clamped`].
    #[must_use]
    pub const fn clamped(kind: Kind, params: Params, now: Nanos) -> Self {
        match kind {
            Kind::Corrected => Self::Corrected(Corrected::clamped(params, now)),
            #[cfg(feature = "posix")]
            Kind::Posix => Self::Posix(Posix::clamped(params, now)),
        }
    }

    /// Sets the smallest amount worth raising the thread for, in ns; see
    /// [`Corrected::with_min_chunk`]. The POSIX server has no such rule and stays as it is.
    #[must_use]
    pub fn with_min_chunk(self, min_chunk: Nanos) -> Self {
        match self {
            Self::Corrected(server) => Self::Corrected(server.with_min_chunk(min_chunk)),
            #[cfg(feature = "posix")]
            posix @ Self::Posix(_) => posix,
        }
    }

    /// The kind of this server.
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Corrected(_) => Kind::Corrected,
            #[cfg(feature = "posix")]
            Self::Posix(_) => Kind::Posix,
        }
    }
}

/// Calls the same method on whichever server it is.
macro_rules! either {
    ($self:ident, $server:ident => $call:expr) => {
        match $self {
            Server::Corrected($server) => $call,
            #[cfg(feature = "posix")]
            Server::Posix($server) => $call,
        }
    };
}

impl<const N: usize> BudgetServer for Server<N> {
    fn params(&self) -> &Params {
        either!(self, s => s.params())
    }

    fn activate(&mut self, now: Nanos) {
        either!(self, s => s.activate(now));
    }

    fn block(&mut self, now: Nanos) {
        either!(self, s => s.block(now));
    }

    fn charge(&mut self, used: Nanos, now: Nanos) {
        either!(self, s => s.charge(used, now));
    }

    fn update(&mut self, now: Nanos) -> Level {
        either!(self, s => s.update(now))
    }

    fn available(&self, now: Nanos) -> Nanos {
        either!(self, s => s.available(now))
    }

    fn next_replenishment(&self) -> Option<Nanos> {
        either!(self, s => s.next_replenishment())
    }

    fn pending(&self) -> usize {
        either!(self, s => s.pending())
    }
}
