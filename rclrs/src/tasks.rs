//! Async tasks on the thread that spins: node callbacks, and futures of `commands().run`.

use crate::crew::Event;
use futures::future::BoxFuture;
use futures::task::{ArcWake, waker_ref};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::Context;

/// A task between two polls; `None` while it is polled and when it is done.
pub(crate) struct Task {
    future: Mutex<Option<BoxFuture<'static, ()>>>,
    events: Sender<Event>,
}

impl Task {
    /// Queues a new task.
    pub(crate) fn add(events: &Sender<Event>, future: BoxFuture<'static, ()>) {
        let task = Arc::new(Self {
            future: Mutex::new(Some(future)),
            events: events.clone(),
        });
        // The runtime is gone: the task ends here, as rclrs's own runtime does it.
        events.send(Event::Ready(task)).ok();
    }

    /// Polls it once.
    pub(crate) fn poll(self: &Arc<Self>) {
        let mut slot = self.future.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(mut future) = slot.take() else {
            return;
        };
        let waker = waker_ref(self);
        if future
            .as_mut()
            .poll(&mut Context::from_waker(&waker))
            .is_pending()
        {
            *slot = Some(future);
        }
    }
}

impl ArcWake for Task {
    fn wake_by_ref(task: &Arc<Self>) {
        task.events.send(Event::Ready(Arc::clone(task))).ok();
    }
}
