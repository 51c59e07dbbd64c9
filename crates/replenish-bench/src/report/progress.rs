//! Progress on standard error: a bar that redraws itself on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Without a terminal there is a line at most this often.
const PLAIN_INTERVAL: Duration = Duration::from_secs(2);

/// Shows how far a run is.
#[derive(Debug)]
pub(crate) struct Progress {
    terminal: bool,
    last: Option<Instant>,
    drawn: bool,
}

impl Progress {
    /// Progress on standard error.
    pub(crate) fn new() -> Self {
        Self {
            terminal: std::io::stderr().is_terminal(),
            last: None,
            drawn: false,
        }
    }

    /// `done` of `total` steps are done; `detail` is a short remark.
    pub(crate) fn step(&mut self, done: usize, total: usize, detail: &str) {
        if self.terminal {
            eprint!("\r\x1b[2K  {} {detail}", bar(done, total));
            std::io::stderr().flush().ok(); // a bar that is late does no harm
            self.drawn = true;
        } else if done >= total || self.last.is_none_or(|t| t.elapsed() >= PLAIN_INTERVAL) {
            self.last = Some(Instant::now());
            eprintln!("  {done}/{total}  {detail}");
        }
    }

    /// Removes the bar.
    pub(crate) fn clear(&mut self) {
        if std::mem::take(&mut self.drawn) {
            eprint!("\r\x1b[2K");
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

fn bar(done: usize, total: usize) -> String {
    const WIDTH: usize = 30;
    let full = (WIDTH * done.min(total))
        .checked_div(total)
        .unwrap_or(WIDTH);
    format!(
        "[{}{}] {done}/{total}",
        "#".repeat(full),
        ".".repeat(WIDTH - full)
    )
}

#[cfg(test)]
mod tests {
    use super::bar;

    #[test]
    fn the_bar_fills_up() {
        assert_eq!(bar(0, 4), format!("[{}] 0/4", ".".repeat(30)));
        assert_eq!(bar(4, 4), format!("[{}] 4/4", "#".repeat(30)));
        assert_eq!(bar(0, 0), format!("[{}] 0/0", "#".repeat(30)));
    }
}
