//! rclpy reads our log, and sets the levels of our loggers.

use crate::peer::{Foreign, Peer};
use crate::support::{executor, node};
use replenish::args::LogLevel;
use replenish::{log_debug, log_info, log_warn};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Set when it is dropped, by a failed assertion, too.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// rclpy comes late, reads the lines that it missed, and sets a level.
pub(crate) fn logs(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let logger = node.logger();
    let mut exec = executor(&node);
    exec.worker("levels").logger_levels(&node).unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["logs", "/peer/ours"]);
    // A line lives for ten seconds, and rclpy may take longer to begin.
    let heard = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !heard.load(Ordering::Relaxed) {
                log_debug!(logger, "not enabled");
                log_info!(logger, "starts");
                log_warn!(logger, "is warm");
                std::thread::sleep(Duration::from_secs(2));
            }
        });
        let ends = Ends(&heard);
        let lines: [String; 3] = [peer.line(), peer.line(), peer.line()];
        drop(ends);
        let said = |text| lines.iter().any(|line| line == text);
        assert!(said("20 starts logs.rs True True"), "{lines:?}");
        assert!(said("30 is warm logs.rs True True"), "{lines:?}");
    });
    assert_eq!(peer.line(), "RELIABLE TRANSIENT_LOCAL 10000000000");
    assert_eq!(peer.line(), "[True]");
    assert_eq!(peer.line(), "[40, 0]");
    assert_eq!(logger.level(), LogLevel::Error);
    drop(running.stop());
}
