//! The grid of a run, which a role under the orchestrator reads from its standard input.

use crate::load::grid::Grid;
use replenish_cli::signals::Stop;
pub(crate) use replenish_cli::supervised::emit;
use std::sync::{Arc, OnceLock};

/// The grid of this run, once the orchestrator has handed it out.
pub(crate) type SharedGrid = Arc<OnceLock<Grid>>;

/// Reads the grid on a thread of its own; end of file stops the process.
pub(crate) fn listen(grid: SharedGrid, stop: Stop) {
    replenish_cli::supervised::listen(stop, move |line| {
        if let Ok(read) = serde_json::from_str(line) {
            grid.set(read).ok(); // a second grid is ignored
        }
    });
}
