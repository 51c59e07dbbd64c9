//! The child's end of the [protocol](super::protocol): grid and stop from standard input, events
//! to standard output.

use super::protocol::Event;
use crate::load::grid::Grid;
use crate::signals::Stop;
use std::io::{BufRead, Write};
use std::sync::{Arc, OnceLock};

/// Writes one event as a line. A reader that has gone is noticed as end of file on the input.
pub(crate) fn emit(event: &Event) {
    if let Ok(line) = serde_json::to_string(event) {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{line}").and_then(|()| out.flush()).ok();
    }
}

/// The grid of this run, once the orchestrator has handed it out.
pub(crate) type SharedGrid = Arc<OnceLock<Grid>>;

/// Reads standard input on a thread of its own: first the grid, then end of file, which stops.
pub(crate) fn listen(grid: SharedGrid, stop: Stop) {
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if let Ok(g) = serde_json::from_str(&line) {
                grid.set(g).ok(); // a second grid is ignored
            }
        }
        stop.trigger();
    });
}
