//! The runtime: a spin wakes every worker's thread, runs async tasks here, and ends with the last
//! worker.

use crate::channel::Workers;
use crate::crew::{Crew, Event};
use crate::tasks::Task;
use futures::channel::oneshot;
use futures::future::BoxFuture;
use rclrs::{ExecutorChannel, ExecutorRuntime, RclrsError, SpinConditions, WaitSetRunConditions};
use replenish_threads::{self as threads, Failure};
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;

/// An executor's runtime with one thread for each worker, for `Context::create_executor`.
///
/// # Errors
/// The privilege for real-time threads is missing, and the text says how to grant it; or the
/// deployment file that `REPLENISH_OVERLAY` names cannot be read.
pub fn runtime() -> Result<Runtime, Failure> {
    threads::check()?;
    let (sender, events) = channel();
    Ok(Runtime {
        crew: Crew::new(sender),
        events,
    })
}

/// An executor's runtime; made by [`runtime`].
///
/// A callback's panic ends the spin and goes on there.
pub struct Runtime {
    crew: Arc<Crew>,
    events: Receiver<Event>,
}

impl std::fmt::Debug for Runtime {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Runtime").finish_non_exhaustive()
    }
}

impl ExecutorRuntime for Runtime {
    fn channel(&self) -> Arc<dyn ExecutorChannel> {
        Arc::new(Workers(Arc::clone(&self.crew)))
    }

    fn spin(&mut self, conditions: SpinConditions) -> Vec<RclrsError> {
        let conditions = self.conditions(conditions);
        let mut errors = Vec::new();
        let mut panic = None;
        let mut running = self.crew.spin(&conditions);
        while running {
            // The crew holds a sender, so the channel is open.
            let Ok(event) = self.events.recv() else { break };
            match event {
                Event::Ready(task) => task.poll(),
                Event::Ended(ended) => {
                    match ended {
                        Ok(Ok(())) => {}
                        Ok(Err(error)) => errors.push(error),
                        Err(payload) => {
                            panic.get_or_insert(payload);
                            conditions.halt_spinning.store(true, Ordering::Release);
                        }
                    }
                    running = !self.crew.ended();
                    // One that stopped all, by a panic or without its budget, has woken nobody.
                    if running && conditions.halt_spinning.load(Ordering::Acquire) {
                        self.crew.wake();
                    }
                }
            }
        }
        // Each ready task gets its turn; tasks that become ready by it wait for the next spin.
        let ready: Vec<Event> = self.events.try_iter().collect();
        for event in ready {
            if let Event::Ready(task) = event {
                task.poll();
            }
        }
        match panic {
            Some(payload) => resume_unwind(payload),
            None => errors,
        }
    }

    fn spin_async(
        mut self: Box<Self>,
        conditions: SpinConditions,
    ) -> BoxFuture<'static, (Box<dyn ExecutorRuntime>, Vec<RclrsError>)> {
        let (sender, receiver) = oneshot::channel();
        // A spin blocks its thread, which may be that of an async executor.
        let thread = std::thread::spawn(move || {
            let errors = self.spin(conditions);
            sender.send((self as Box<dyn ExecutorRuntime>, errors)).ok();
        });
        Box::pin(async move {
            match receiver.await {
                Ok(ended) => ended,
                Err(oneshot::Canceled) => match thread.join() {
                    Err(payload) => resume_unwind(payload),
                    Ok(()) => std::future::pending().await, // it has sent before it ended
                },
            }
        })
    }
}

impl Runtime {
    fn conditions(&self, mut conditions: SpinConditions) -> WaitSetRunConditions {
        if let Some(promise) = conditions.options.until_promise_resolved.take() {
            let halt = Arc::clone(&conditions.halt_spinning);
            let crew = Arc::clone(&self.crew);
            let until = async move {
                // Kept or broken, it ends the spin. A wait set that is woken must see the halt.
                promise.await.ok();
                halt.store(true, Ordering::Release);
                crew.wake();
            };
            Task::add(self.crew.events(), Box::pin(until));
        }
        WaitSetRunConditions {
            only_next_available_work: conditions.options.only_next_available_work,
            stop_time: conditions
                .options
                .timeout
                .and_then(|timeout| Instant::now().checked_add(timeout)),
            context: conditions.context,
            halt_spinning: conditions.halt_spinning,
        }
    }
}

impl Drop for Runtime {
    fn drop(&mut self) {
        self.crew.end();
    }
}
