//! Foreign programs hear how our executor is, without a word in our program.

use crate::peer::{Foreign, Peer};
use crate::support::{executor, node};
use replenish::{HandleOptions, OnMiss, RunningExecutor};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// A worker that is late and one that is not.
fn start() -> (RunningExecutor, u16) {
    let (node, domain) = node("/peer/ours");
    let mut exec = executor(&node);
    let options = HandleOptions::new().deadline(MS, OnMiss::Count);
    exec.worker("late")
        .timer(20 * MS, |_| std::thread::sleep(5 * MS))
        .unwrap()
        .options(options);
    exec.worker("well").timer(20 * MS, |_| ()).unwrap();
    (exec.start().unwrap(), domain)
}

/// rclpy reads `/diagnostics`.
pub(crate) fn diagnostics(foreign: Foreign) {
    let (running, domain) = start();
    let peer = Peer::start(foreign, domain, &["diagnostics"]);
    assert_eq!(peer.line(), "late 1 callbacks late");
    assert_eq!(peer.line(), "dispatcher late well");
    assert_eq!(peer.line(), "True 12");
    assert_eq!(peer.line(), "ours True");
    drop(running.stop());
}

/// A program on bare DDS reads `/statistics`: the package index has no `statistics_msgs` for rclpy.
pub(crate) fn statistics(foreign: Foreign) {
    let (running, domain) = start();
    let peer = Peer::start(foreign, domain, &["statistics", "4"]);
    for handle in ["late/timer:0", "well/timer:0"] {
        for source in ["latency", "response"] {
            // Of mean, minimum, maximum, standard deviation and count: the first three in order,
            // and a response of `late` is its 5 ms of sleep at least.
            let line = format!("{handle} {source} ms [1, 2, 3, 4, 5] True");
            assert_eq!(peer.line(), line);
        }
    }
    drop(running.stop());
}
