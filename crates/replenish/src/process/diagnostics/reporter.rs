//! The thread that publishes, once a second. It allocates when handles have come, and else not.

use super::array::{Array, refusal};
use super::metrics::Metrics;
use crate::Nanos;
use crate::context::Node;
use crate::event::{Event, Events};
use crate::executor::{HandleState, Live};
use crate::middleware::PublishError;
use crate::publisher::Publisher;
use crate::sync::Notify;
use replenish_interfaces::diagnostic_msgs::msg::DiagnosticArray;
use replenish_interfaces::statistics_msgs::msg::MetricsMessage;
use replenish_msg::builtin_interfaces::Time;
use replenish_os::clock;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::vec::Vec;

const SECOND: Nanos = 1_000_000_000;

/// The thread's end.
#[derive(Default)]
pub(super) struct End {
    pub(super) asked: AtomicBool,
    pub(super) notify: Notify,
}

/// The publishers.
pub(super) struct Out {
    pub(super) diagnostics: Publisher<DiagnosticArray>,
    pub(super) statistics: Publisher<MetricsMessage>,
}

/// The state of the thread.
pub(super) struct Reporter {
    pub(super) end: Arc<End>,
    pub(super) node: Node,
    pub(super) live: Arc<Live>,
    pub(super) events: Arc<Events>,
    pub(super) array: Array,
    pub(super) out: Out,
    pub(super) told: bool,
    /// Every handle with its worker's name; between looks it is empty room.
    pub(super) handles: Handles,
}

pub(super) type Handles = Vec<(Arc<str>, Arc<HandleState>)>;

impl Reporter {
    pub(super) fn run(mut self) {
        let mut handles = core::mem::take(&mut self.handles);
        let mut metrics = Metrics::new();
        let mut start = self.node.now();
        let mut next = clock::monotonic();
        loop {
            next = next.saturating_add(SECOND).max(clock::monotonic());
            while !self.end.asked.load(Ordering::Acquire) && clock::monotonic() < next {
                self.end.notify.wait_until(next);
            }
            if self.end.asked.load(Ordering::Acquire) {
                return;
            }
            let stop = self.node.now();
            self.live.registry.copy_into(&mut handles);
            self.say_state(stop, &handles);
            self.say_figures((start, stop), &handles, &mut metrics);
            handles.clear(); // a handle that leaves meanwhile is not held
            start = stop;
        }
    }

    fn say_state(&mut self, now: Time, handles: &[(Arc<str>, Arc<HandleState>)]) {
        let middleware = &**self.node.context().middleware();
        let message = self.array.at(now, handles, middleware);
        let sent = self.out.diagnostics.publish(message);
        self.tell("/diagnostics", sent);
    }

    fn say_figures(
        &mut self,
        window: (Time, Time),
        handles: &[(Arc<str>, Arc<HandleState>)],
        metrics: &mut Metrics,
    ) {
        for (_, handle) in handles {
            let all = [("latency", &handle.latency), ("response", &handle.response)];
            for (source, histogram) in all {
                let seen = histogram.take_window();
                if seen.count > 0 {
                    let message = metrics.of(&handle.id, source, window, &seen);
                    let sent = self.out.statistics.publish(message);
                    self.tell("/statistics", sent);
                }
            }
        }
    }

    /// The first refusal is an event; the next message is tried all the same.
    fn tell(&mut self, topic: &str, sent: Result<(), PublishError>) {
        if let Err(e) = sent
            && !core::mem::replace(&mut self.told, true)
        {
            let message = &*refusal(topic, &e);
            self.events.emit(&Event::Fallback { message });
        }
    }
}
