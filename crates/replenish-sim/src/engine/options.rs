//! How long a run is, and what is drawn and recorded in it.

use crate::Nanos;

/// How to run a system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// How long, in ns.
    pub horizon: Nanos,
    /// The seed of everything drawn.
    pub seed: u64,
    /// Whether to record [`Outcome::trace`](crate::Outcome::trace).
    pub trace: bool,
}

impl Options {
    /// A run of `horizon` ns with seed 0 and without trace.
    pub const fn until(horizon: Nanos) -> Self {
        Self {
            horizon,
            seed: 0,
            trace: false,
        }
    }

    /// Sets the seed.
    #[must_use]
    pub const fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Records the trace.
    #[must_use]
    pub const fn traced(mut self) -> Self {
        self.trace = true;
        self
    }
}
