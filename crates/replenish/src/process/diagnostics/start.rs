//! Starting and ending the thread.

use super::array::{Array, names, refusal};
use super::choice::DiagnosticsChoice;
use super::metrics;
use super::reporter::{End, Handles, Out, Reporter};
use crate::context::{Context, Node};
use crate::error::Error;
use crate::event::Events;
use crate::executor::{Live, ThreadPlan, Topic};
use crate::platform::Text;
use crate::process::Chains;
use crate::qos::Qos;
use replenish_os::{Thread, ThreadSpec, clock, spawn};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The thread may take this long to end, in nanoseconds: it may wait for a CPU.
const PATIENCE: u64 = 50_000_000;

/// The thread that publishes; it ends when this is dropped.
#[derive(Default)]
pub(crate) struct Diagnostics {
    running: Option<(Arc<End>, Thread<()>)>,
    /// The reason why nothing is published though it was to be.
    pub(crate) fallback: Option<Text>,
}

impl Diagnostics {
    /// Starts the thread if `choice` says so. Its first message comes after a second.
    pub(crate) fn start(
        context: &Context,
        choice: &DiagnosticsChoice,
        plans: &[Arc<ThreadPlan>],
        live: &Arc<Live>,
        chains: &Chains,
        events: &Arc<Events>,
    ) -> Self {
        let wanted = choice.0.unwrap_or_else(|| context.middleware().is_ros());
        if !wanted {
            return Self::default();
        }
        let Some(name) = context.first_node().name() else {
            // A program without nodes is not seen in ROS: it misses nothing unless it has asked.
            let why = || refusal("/diagnostics", &"the context has no node");
            return Self {
                running: None,
                fallback: choice.0.map(|_| why()),
            };
        };
        let made = context.existing(name).and_then(|node| {
            let out = publishers(&node, plans.len() + chains.0.len())?;
            Ok((node, out))
        });
        let running = made.and_then(|(node, out)| {
            let (program, host) = names();
            let end = Arc::<End>::default();
            let mut handles = Handles::new();
            live.registry.copy_into(&mut handles); // room for all that are there now
            handles.clear();
            let reporter = Reporter {
                end: Arc::clone(&end),
                node,
                live: Arc::clone(live),
                events: Arc::clone(events),
                array: Array::new(&program, &host, plans, live, chains),
                out,
                told: false,
                handles,
            };
            let thread = spawn(ThreadSpec::new("diagnostics"), move || reporter.run());
            thread
                .map(|thread| (end, thread))
                .map_err(|e| Error::Thread {
                    name: "diagnostics".into(),
                    reason: std::format!("{e}"),
                })
        });
        match running {
            Ok(running) => Self {
                running: Some(running),
                fallback: None,
            },
            Err(e) => Self {
                running: None,
                fallback: Some(refusal("/diagnostics", &e)),
            },
        }
    }

    /// Ends the thread. One that gets no CPU is left behind: it ends by itself.
    pub(crate) fn end(&mut self) {
        if let Some((end, thread)) = self.running.take() {
            end.asked.store(true, Ordering::Release);
            end.notify.set();
            drop(thread.join_until(clock::monotonic().saturating_add(PATIENCE)));
        }
    }
}

impl Drop for Diagnostics {
    fn drop(&mut self) {
        self.end();
    }
}

fn publishers(node: &Node, statuses: usize) -> Result<Out, Error> {
    let diagnostics = Topic::named("/diagnostics").max_size(Array::most(statuses));
    let statistics = Topic::named("/statistics").max_size(metrics::MOST);
    Ok(Out {
        diagnostics: node.publisher(diagnostics, Qos::reliable().keep_last(1))?,
        statistics: node.publisher(statistics, Qos::reliable().keep_last(64))?,
    })
}
