//! The ends that rclrs calls: to make a worker, and to give it work.

use crate::crew::Crew;
use crate::payload;
use crate::tasks::Task;
use futures::channel::mpsc::UnboundedSender;
use futures::future::BoxFuture;
use rclrs::{
    ExecutorChannel, ExecutorWorkerOptions, PayloadTask, WaitSetRunner, Waitable,
    WeakActivityListener, WorkerChannel,
};
use std::sync::{Arc, Mutex, PoisonError};

/// Makes workers of one runtime.
pub(crate) struct Workers(pub(crate) Arc<Crew>);

impl ExecutorChannel for Workers {
    fn create_worker(&self, options: ExecutorWorkerOptions) -> Arc<dyn WorkerChannel> {
        let found = payload::find(&*options.payload);
        let runner = WaitSetRunner::new(options);
        let worker = Worker {
            crew: Arc::clone(&self.0),
            waitables: runner.waitable_sender(),
            tasks: runner.payload_task_sender(),
            listeners: runner.activity_listeners(),
        };
        self.0.begin(runner, found);
        Arc::new(worker)
    }

    fn wake_all_wait_sets(&self) {
        self.0.wake();
    }
}

/// Gives work to one worker. Where the worker is gone, the work ends unheard, as in rclrs's own
/// runtime.
struct Worker {
    crew: Arc<Crew>,
    waitables: UnboundedSender<Waitable>,
    tasks: UnboundedSender<PayloadTask>,
    listeners: Arc<Mutex<Vec<WeakActivityListener>>>,
}

impl WorkerChannel for Worker {
    fn add_async_task(&self, task: BoxFuture<'static, ()>) {
        Task::add(self.crew.events(), task);
    }

    fn add_to_wait_set(&self, waitable: Waitable) {
        self.waitables.unbounded_send(waitable).ok();
    }

    fn send_payload_task(&self, task: PayloadTask) {
        self.tasks.unbounded_send(task).ok();
    }

    fn add_activity_listener(&self, listener: WeakActivityListener) {
        let mut listeners = self
            .listeners
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        listeners.push(listener);
    }
}
