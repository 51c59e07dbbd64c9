//! A handle whose callback makes a future.
//!
//! ```text
//!             input, and its future is not done            done
//!   waiting ──────────────────────────────────► in flight ──────► waiting
//!      │                                          │     ▲
//!      └── input, and its future is done at once  └─────┘ woken: polled
//! ```
//!
//! In flight it takes no input: samples wait in the inbox as its quality says, releases of a timer
//! are skipped. A future that sleeps has left its alarms here: they are the handle's releases.

use super::callback::CallbackResult;
use super::entry::HandleEntry;
use super::env::Env;
use super::handle::{Handle, Taken};
use super::one_user::OneUser;
use super::state::HandleState;
use super::waker::HandleWaker;
use crate::Nanos;
use crate::executor::wake::doorbell::WakeHandle;
use crate::executor::wake::lazy_now::LazyNow;
use crate::executor::wake::run_queue::RunQueue;
use crate::platform::chain::Provenance;
use crate::platform::sleeping::{self, Alarms};
use crate::sync::Arc;
use alloc::boxed::Box;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, Waker};
use replenish_os::clock;

/// The room for a handle's future. The handle and its callback share it on one thread, one after
/// the other.
pub(crate) type Room<F> = Arc<OneUser<Pin<Box<Option<F>>>>>;

/// An empty room.
pub(crate) fn room<F>() -> Room<F> {
    Arc::new(OneUser::new(Box::pin(None)))
}

/// Puts a future into its room.
pub(crate) fn put<F>(room: &Room<F>, future: F) {
    room.with(|room| room.as_mut().set(Some(future)));
}

struct Async<F> {
    /// Takes the input and calls the callback, which makes a future.
    input: Box<dyn Handle>,
    shared: Arc<HandleState>,
    room: Room<F>,
    waker: alloc::sync::Arc<HandleWaker>,
    as_waker: Waker,
    in_flight: bool,
    alarms: alloc::sync::Arc<Alarms>,
    /// The run queue knows a release of this handle that may be an alarm.
    alarmed: bool,
}

/// The handle of an entry, whose callback puts futures into `room`. With one in it already, it is
/// in flight from the start.
pub(crate) fn polled<F, R>(mut entry: HandleEntry, room: Room<F>) -> HandleEntry
where
    F: Future<Output = R> + Send + 'static,
    R: CallbackResult + 'static,
{
    let waker = HandleWaker::new();
    let as_waker = Waker::from(alloc::sync::Arc::clone(&waker));
    let in_flight = room.with(|room| room.is_some()) == Some(true);
    if in_flight {
        as_waker.wake_by_ref();
    }
    let shared = Arc::clone(&entry.shared);
    let input = entry.take_handle();
    entry.handle = Box::new(Async {
        input,
        shared,
        room,
        waker,
        as_waker,
        in_flight,
        alarms: alloc::sync::Arc::default(),
        alarmed: false,
    });
    entry
}

impl<F, R> Async<F>
where
    F: Future<Output = R>,
    R: CallbackResult,
{
    fn poll(&mut self) -> Option<R> {
        let mut cx = Context::from_waker(&self.as_waker);
        let polled = self.room.with(|room| {
            let future = room.as_mut().as_pin_mut()?;
            let polled = sleeping::polling(&self.alarms, || future.poll(&mut cx));
            if polled.is_ready() {
                room.as_mut().set(None);
            }
            Some(polled)
        });
        match polled.flatten()? {
            Poll::Pending => {
                self.in_flight = true;
                None
            }
            Poll::Ready(result) => {
                self.in_flight = false;
                Some(result)
            }
        }
    }
}

impl<F, R> Handle for Async<F>
where
    F: Future<Output = R> + Send,
    R: CallbackResult,
{
    fn begin(&mut self, start: Nanos, wake: &WakeHandle) {
        self.waker.begin(wake);
        self.input.begin(start, wake);
    }

    fn is_ready(&mut self, now: &LazyNow) -> bool {
        if self.in_flight {
            let next = self.alarms.next();
            if next.is_some_and(|due| due <= now.get()) && self.alarms.expire(now.get()) {
                self.as_waker.wake_by_ref();
            }
            self.waker.is_woken()
        } else {
            self.input.is_ready(now)
        }
    }

    fn next_release(&mut self) -> Option<Nanos> {
        if self.in_flight {
            self.alarms.next()
        } else {
            self.input.next_release()
        }
    }

    fn note_release(&mut self, position: usize, run_queue: &mut RunQueue) {
        let alarm = self.alarms.next().filter(|_| self.in_flight);
        let alarmed = core::mem::replace(&mut self.alarmed, alarm.is_some());
        if alarmed || alarm.is_some() || self.in_flight && self.input.next_release().is_some() {
            let next = self.next_release();
            run_queue.next_release_of(position, next);
        } else if !self.in_flight {
            self.input.note_release(position, run_queue);
        }
    }

    fn take(&mut self, env: &Env<'_>) -> Option<Taken> {
        let woken = self.waker.take(); // of an earlier future, if none is in flight
        if !self.in_flight {
            return self.input.take(env);
        }
        woken.then(|| Taken {
            due: clock::monotonic(),
            deadline: None,
            provenance: Provenance::default(),
        })
    }

    fn is_awaited(&self) -> bool {
        self.in_flight
    }

    fn execute(&mut self, env: &Env<'_>, started: Nanos) {
        if !self.in_flight {
            self.input.execute(env, started);
        }
        if let Some(result) = self.poll() {
            result.inspect(&mut |e| self.shared.failed(e, env.events));
        }
    }

    fn was_spoiled(&mut self) -> bool {
        self.input.was_spoiled()
    }
}
