//! The interface of every budget server.

use crate::{Nanos, Params};

/// The level a thread must have: its priority P, or what its [`Low`](crate::Low) says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Level {
    /// Budget is available: run at P.
    High,
    /// No budget: run at the background priority, or not at all.
    Low,
}

/// The budget of one thread, driven by events of that thread and of time.
///
/// Times are on one monotonic clock. A `now` below an earlier one counts as that earlier one, so
/// that two observers on two CPUs cannot turn time back. Preemption is no event of its own:
/// [`charge`](Self::charge) what was consumed. No method panics or allocates; each takes time
/// bounded by `max_repl`.
pub trait BudgetServer {
    /// The parameters the server was made with.
    fn params(&self) -> &Params;

    /// The thread leaves waiting (blocked -> runnable). A new server holds a waiting thread. Called
    /// for a thread that is not waiting it means that a [`block`](Self::block) at the same instant
    /// went unseen.
    fn activate(&mut self, now: Nanos);

    /// The thread waits (runnable -> blocked). Charge its consumption first.
    fn block(&mut self, now: Nanos);

    /// `used` ns of CPU were consumed at [`Level::High`] since the last charge, up to `now`. May
    /// exceed what was available (an overrun).
    fn charge(&mut self, used: Nanos, now: Nanos);

    /// Applies everything due at `now` and returns the level the thread must have. Idempotent.
    fn update(&mut self, now: Nanos) -> Level;

    /// CPU time in ns that may be consumed at High from `now` on without any further event; 0 if
    /// and only if [`update`](Self::update) at `now` would return [`Level::Low`].
    fn available(&self, now: Nanos) -> Nanos;

    /// While Low: when the next replenishment comes, a time at which the level can change without
    /// an event of the thread. None while High. As of the latest time seen.
    fn next_replenishment(&self) -> Option<Nanos>;

    /// Scheduled replenishments, as of the latest time seen.
    fn pending(&self) -> usize;
}
