//! Stand-in for the watchdog: nothing but the kernel can stop an enforcer of a microcontroller.

use super::config::Fault;
use super::state::EnforcerState;
use crate::backend::spawn_error::SpawnError;
use crate::{Arc, Tid};

#[derive(Debug)]
pub(super) struct Supervision;

/// The body of an enforcer's thread.
pub(super) struct Watched(Arc<EnforcerState>);

impl Watched {
    pub(super) fn of(state: &Arc<EnforcerState>) -> Arc<Self> {
        Arc::new(Self(Arc::clone(state)))
    }

    pub(super) fn run(&self) {
        self.0.run();
    }
}

impl Supervision {
    pub(super) fn of(_: Arc<Watched>, _: Tid) -> Self {
        Self
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn refused(&self) -> Option<&SpawnError> {
        None
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) fn on_fault(&self, _: impl Fn(&Fault)) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn end(&self) {}
}
