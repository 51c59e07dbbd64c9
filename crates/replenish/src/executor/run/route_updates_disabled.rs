//! In the place of `route_updates` in builds without feature `full`: routes do not change.

use super::routes::Route;
use crate::middleware::{Interest, Middleware};
use crate::sync::Arc;

/// In this build routes do not change.
pub(crate) struct RouteUpdates;

impl RouteUpdates {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self)
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn open(&self) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn carry_out(
        &self,
        _: &dyn Middleware,
        _: &mut [Option<Route>],
        _: &mut Interest,
        _: &mut Interest,
    ) {
    }
}
