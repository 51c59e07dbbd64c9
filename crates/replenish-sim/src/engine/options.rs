//! The options of a run: its length, and what it draws and records.

use crate::Nanos;

/// Options of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Length of the run, in ns.
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
