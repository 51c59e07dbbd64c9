//! Where the dispatcher brings samples.

use super::doorbell::Line;
use super::handle::Shared;
use crate::sync::Arc;

/// Where a reader's samples go.
pub(crate) struct Route {
    pub(crate) shared: Arc<Shared>,
    /// Index into the dispatcher's bells.
    pub(crate) worker: usize,
    /// Marks the handle.
    pub(crate) line: Line,
}
