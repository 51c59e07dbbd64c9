//! Ping's other half: it sends back each message. So the sender counts what a line loses, or
//! measures the way there and back.

use replenish::msg::std_msgs::Int32;
use replenish::{CallbackContext, Node, Qos, WorkerBuilder};
use replenish_cli::outcome::Failure;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Messages of one topic, counted where they are sent back.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Echoed {
    /// Messages received.
    pub received: u64,
    /// Received with a number not above the one before: a duplicate, or out of order.
    pub again: u64,
    /// Sent back.
    pub sent: u64,
    /// Samples that the middleware did not take.
    pub failed: u64,
}

#[derive(Debug, Default)]
struct Count {
    received: AtomicU64,
    again: AtomicU64,
    sent: AtomicU64,
    failed: AtomicU64,
}

/// The counts of topics sure and loose.
#[derive(Debug, Default)]
pub(crate) struct Echo(Arc<[Count; 2]>);

impl Echo {
    /// Adds both to `worker`.
    pub(crate) fn add<'e>(
        mut worker: WorkerBuilder<'e>,
        node: &Node,
    ) -> Result<(WorkerBuilder<'e>, Self), Failure> {
        let echo = Self::default();
        // Reliable without dropping: what waits for its turn waits in the agent.
        let qos = [Qos::reliable().keep_all(16), Qos::best_effort()];
        for (n, (name, qos)) in ["sure", "loose"].into_iter().zip(qos).enumerate() {
            let back = format!("{name}_back");
            let back = node
                .publisher::<Int32>(&back, qos)
                .map_err(Failure::refused)?;
            let counts = Arc::clone(&echo.0);
            let mut last = None;
            let send_back = move |message: &Int32, _: &CallbackContext<'_>| {
                let Some(count) = counts.get(n) else { return };
                count.received.fetch_add(1, Ordering::Relaxed);
                if last.is_some_and(|last| message.data <= last) {
                    count.again.fetch_add(1, Ordering::Relaxed);
                }
                last = Some(message.data);
                let sent = back.publish(message).is_ok();
                let tally = if sent { &count.sent } else { &count.failed };
                tally.fetch_add(1, Ordering::Relaxed);
            };
            worker = worker
                .subscribe(node, name, qos, send_back)
                .map_err(Failure::refused)?;
        }
        Ok((worker, echo))
    }

    /// The counts so far, of topics sure and loose.
    pub(crate) fn totals(&self) -> [Echoed; 2] {
        let get = |n: &AtomicU64| n.load(Ordering::Relaxed);
        self.0.each_ref().map(|count| Echoed {
            received: get(&count.received),
            again: get(&count.again),
            sent: get(&count.sent),
            failed: get(&count.failed),
        })
    }
}
