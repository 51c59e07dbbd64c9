//! The context that a callback gets besides its message, and the values that it may return.

use super::env::Env;
use super::state::HandleState;
use crate::Nanos;
use crate::executor::wake::stop::StopHandle;
use crate::handoff::{RequestIdentity, SampleInfo};
use crate::middleware::PublishError;
use crate::middleware::encoding::Encoding;
use crate::middleware::remedy::BARRIER;
use crate::platform::{Mark, displayed, recorder};
use crate::publisher::Publisher;
use crate::sync::Ordering;
use core::fmt;
use replenish_msg::Message;
use replenish_os::clock;

/// Facts about the callback that runs, and the ways to act on its executor from inside it.
pub struct CallbackContext<'a> {
    pub(crate) env: &'a Env<'a>,
    pub(crate) shared: &'a HandleState,
    pub(crate) due: Nanos,
    pub(crate) started: Nanos,
    pub(crate) skipped: u64,
    /// The information about the sample, if there is one.
    pub(crate) sample: Option<&'a SampleInfo>,
}

impl<'a> CallbackContext<'a> {
    pub(crate) fn new(
        env: &'a Env<'a>,
        shared: &'a HandleState,
        due: Nanos,
        started: Nanos,
    ) -> Self {
        Self {
            env,
            shared,
            due,
            started,
            skipped: 0,
            sample: None,
        }
    }

    /// The context of a callback for `sample`.
    pub(crate) fn about(
        sample: &'a SampleInfo,
        env: &'a Env<'a>,
        shared: &'a HandleState,
        started: Nanos,
    ) -> Self {
        Self {
            sample: Some(sample),
            ..Self::new(env, shared, sample.arrival, started)
        }
    }
}

impl CallbackContext<'_> {
    /// The handle's id: `/node/sub:/topic`, `worker/timer:0`.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.shared.id
    }

    /// The worker's name.
    #[must_use]
    pub fn worker(&self) -> &str {
        self.env.worker
    }

    /// The sample's arrival in this process, or the timer's release: the *expected* time of the
    /// call (`CLOCK_MONOTONIC`).
    #[must_use]
    pub fn due(&self) -> Nanos {
        self.due
    }

    /// Time at which the callback started: the *actual* time of the call (`CLOCK_MONOTONIC`).
    #[must_use]
    pub fn started(&self) -> Nanos {
        self.started
    }

    /// This moment (`CLOCK_MONOTONIC`).
    #[must_use]
    pub fn now(&self) -> Nanos {
        clock::monotonic()
    }

    /// Timers: releases left out since the previous callback because they were overrun. Guard
    /// conditions: triggers that this callback serves besides the first.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Time at which the sample was published, by the publisher's clock, in nanoseconds since the
    /// Unix epoch; `None` where the middleware does not tell (DDS-XRCE), and without a sample.
    #[must_use]
    pub fn source_timestamp(&self) -> Option<Nanos> {
        self.sample?.source_timestamp
    }

    /// The sample's number among those of its writer; `None` where the middleware does not tell
    /// (DDS-XRCE), and without a sample.
    #[must_use]
    pub fn sequence(&self) -> Option<u64> {
        self.sample?.sequence
    }

    /// Services: which request this is (server) or answers (client, its
    /// [number](RequestIdentity::number) only).
    #[must_use]
    pub fn request(&self) -> RequestIdentity {
        self.sample.map(|s| s.request).unwrap_or_default()
    }

    /// Nanoseconds of CPU time left in the worker's budget at this moment; `None` without a budget.
    /// Takes the enforcer's lock for a moment.
    #[must_use]
    pub fn remaining_budget(&self) -> Option<Nanos> {
        let meter = self.env.meter;
        meter.enforcement()?;
        Some(meter.usage().available)
    }

    /// Publishes behind the worker's output barrier: at the end of the round (see
    /// [`WorkerBuilder::output_barrier`](crate::WorkerBuilder::output_barrier)). Without a barrier
    /// it is [`Publisher::publish`].
    ///
    /// # Errors
    /// [`PublishError::Full`] when more samples wait than the barrier holds,
    /// [`PublishError::TooLong`] when the message does not fit. An error at the end of the round
    /// counts for the handle whose callback came last.
    pub fn publish<M: Message>(
        &self,
        publisher: &Publisher<M>,
        message: &M,
    ) -> Result<(), PublishError> {
        match self.env.outbox {
            None => publisher.publish(message),
            Some(outbox) => {
                let (middleware, writer) = publisher.target();
                let encoding = Encoding::of::<M>(BARRIER);
                outbox.borrow_mut().keep(middleware, writer, |room| {
                    let encoded = replenish_msg::encode(message, room);
                    encoded.map_err(|e| encoding.failed(e, room))
                })
            }
        }
    }

    /// Records that the callback has come to this point, with a value of the program's choice:
    /// `replenish trace` shows it. Costs a reading of the clock; nothing where the executor does
    /// not [record](crate::Executor::recorder).
    pub fn mark(&self, mark: Mark, value: u64) {
        recorder::mark(mark, value);
    }

    /// Asks the executor to stop. Returns at once; nothing new starts after this callback.
    pub fn stop(&self) {
        self.env.stop.stop();
    }

    /// Stops the executor from elsewhere. Cloning it does not allocate.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.env.stop.clone()
    }

    /// Whether the executor has been asked to stop: a long callback should look now and then.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.env.stop.is_stopping()
    }

    /// Whether this callback shall end: the executor stops, or its handle is
    /// [removed](crate::Removal::Cancel). A long callback should look now and then.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.shared.cancelled.load(Ordering::Acquire) || self.is_stopping()
    }
}

impl fmt::Debug for CallbackContext<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CallbackContext")
            .field("id", &self.shared.id)
            .field("worker", &self.env.worker)
            .field("due", &self.due)
            .field("started", &self.started)
            .finish_non_exhaustive()
    }
}

/// The return values of callbacks: nothing, or a `Result` whose error is counted and reported.
///
/// An error never ends the executor and never stops the handle.
pub trait CallbackResult {
    /// Calls `report` with the error, if there is one.
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display));
}

impl CallbackResult for () {
    fn inspect(self, _report: &mut dyn FnMut(&dyn fmt::Display)) {}
}

/// Names the type `!`, which stable Rust has and does not name. It leaves this crate as `!` alone.
pub trait Returns {
    /// The type that a function returns.
    type Value;
}

impl<T> Returns for fn() -> T {
    type Value = T;
}

/// A future that never ends: `async { loop { … } }`.
impl CallbackResult for <fn() -> ! as Returns>::Value {
    fn inspect(self, _report: &mut dyn FnMut(&dyn fmt::Display)) {}
}

impl<E: fmt::Display> CallbackResult for Result<(), E> {
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display)) {
        if let Err(e) = self {
            report(displayed(&e));
        }
    }
}

impl<R: CallbackResult> CallbackResult for Option<R> {
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display)) {
        if let Some(result) = self {
            result.inspect(report);
        }
    }
}
