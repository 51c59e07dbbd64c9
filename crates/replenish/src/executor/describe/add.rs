//! Adding handles to a worker: one method for each kind, for a worker that is described
//! ([`WorkerBuilder`](crate::WorkerBuilder)) and for a worker that runs
//! ([`WorkerHandle`](crate::WorkerHandle)).

use super::factory::{HandleFactory, RawType};
use super::topic::Topic;
use crate::context::Node;
use crate::error::Error;
use crate::executor::handles::callback::{CallbackContext, CallbackResult};
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::guard::GuardCondition;
use crate::executor::handles::timer::TimerHandle;
use crate::executor::wake::schedule::Every;
use crate::handoff::Inbox;
use crate::middleware::ReaderId;
use crate::qos::Qos;
use crate::service::bytes::{Bare, Body, Unanswered, answers};
use crate::service::client::Client;
use crate::service::error::NoReply;
use crate::service::responder::Responder;
use crate::sync::Arc;
use replenish_msg::{CdrWriter, Message, Service, Viewed};

/// Adds handles to a worker that is described ([`WorkerBuilder`](crate::WorkerBuilder)) or to one
/// that runs ([`WorkerHandle`](crate::WorkerHandle)).
///
/// A builder returns itself from each method. A worker that runs returns the handle's id, or the
/// ids where a method adds several handles: all of them, or none. A handle runs as soon as the
/// worker has ended the callback it is in; a timer counts from now.
pub struct AddHandles<T>(pub(crate) T);

/// The worker that handles are added to. Implemented by this crate alone.
pub trait Target: Sized {
    /// The result of adding one handle.
    type Added;
    /// The result of adding several handles that belong together.
    type AllAdded;
    /// Takes handles that belong together.
    type Together: Target<Added = AddHandles<Self::Together>, AllAdded = Self::AllAdded>;

    /// Adds the handle that `make` makes.
    fn add(
        self,
        numbering: Numbering,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<Self::Added, Error>;

    /// A handle whose callback runs in every round is about to come.
    fn every_round(&mut self) {}

    /// The next of several handles is the last one: all options apply to it.
    fn next_is_last(&mut self) {}

    /// Several handles that belong together are about to come.
    fn together(self) -> Self::Together;

    /// The handles that belong together are there: the last one and `others` before it.
    fn all_added(self, others: u8) -> Self::AllAdded;

    /// The inbox of the handle that was added last.
    fn last_inbox(&mut self) -> Option<Arc<Inbox>>;

    /// The reader of the executor's handle with this id.
    #[allow(dead_code, reason = "nobody asks for it without feature `std`")]
    fn reader_of(&mut self, id: &str) -> Option<ReaderId>;
}

/// The numbers in the ids of handles without a topic.
#[derive(Debug, Clone, Copy)]
pub enum Numbering {
    /// The handle has a topic.
    None,
    /// Timers are counted.
    Timers,
    /// Guard conditions are counted.
    Guards,
}

impl<T: Target> AddHandles<T> {
    /// Calls `callback` for every message on `topic`, which is a name or a [`Topic`].
    ///
    /// Messages are decoded on this worker, into one message that is reused.
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::ForeignNode`], [`Error::Parameter`] for a depth, size or limit out
    /// of range, [`Error::Middleware`] when the reader cannot be created.
    pub fn subscribe<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: F,
    ) -> Result<T::Added, Error>
    where
        M: Message,
        F: FnMut(&M, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        let called = move |message: Option<&M>, cx: &CallbackContext<'_>| {
            message.map(|message| callback(message, cx))
        };
        self.0.add(Numbering::None, |factory| {
            factory.subscription(node, topic, qos, called)
        })
    }

    /// Calls `callback` in every round of this worker: with a new message on `topic`, or with
    /// `None`. The other handles, the [trigger](crate::WorkerBuilder::trigger) and
    /// [`every`](crate::WorkerBuilder::every) start the rounds.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_always<'t, M, F, R>(
        mut self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        M: Message,
        F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.0.every_round();
        self.0.add(Numbering::None, |factory| {
            factory.always(node, topic, qos, callback)
        })
    }

    /// Calls `callback` with a view of every message on `topic`: strings and sequences stay in the
    /// bytes that came, so nothing is copied and nothing allocates, whatever the size. All bytes
    /// are checked before the callback runs.
    ///
    /// ```
    /// # use replenish::{Context, Error, Executor, Qos, Topic};
    /// # use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
    /// # fn main() -> Result<(), Error> {
    /// # let ctx = Context::in_process();
    /// # let node = ctx.node("n")?;
    /// # let mut exec = Executor::new(&ctx);
    /// let topic = Topic::named("image").max_size(40_000);
    /// exec.worker("w").subscribe_view::<Image, _, _>(
    ///     &node, topic, Qos::sensor_data(), |image: &ImageView<'_>, _| {
    ///         println!("{} bytes of {}", image.data.len(), image.encoding);
    ///     },
    /// )?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_view<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        M: Viewed,
        F: FnMut(&M::View<'_>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.0.add(Numbering::None, |factory| {
            factory.view::<M, _, _>(node, topic, qos, callback)
        })
    }

    /// Calls `callback` with the bytes of every sample on `topic`: CDR without encapsulation
    /// header, in the slot they arrived in. The type is given by its names.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_raw<'t, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        ty: RawType<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.0.add(Numbering::None, |factory| {
            factory.raw(node, topic, ty, qos, callback)
        })
    }

    /// Calls `callback` at every release of a timer, given as a period or an [`Every`].
    ///
    /// Releases are absolute on the monotonic clock; the worker itself waits for them.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a period of 0.
    pub fn timer<F, R>(self, every: impl Into<Every>, callback: F) -> Result<T::Added, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.timed(None, every, callback)
    }

    /// As [`timer`](Self::timer), with a handle that starts it, cancels it or changes its period.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a period of 0, or if `handle` belongs to a timer already.
    pub fn timer_with<F, R>(
        self,
        handle: &TimerHandle,
        every: impl Into<Every>,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.timed(Some(handle), every, callback)
    }

    fn timed<F, R>(
        self,
        handle: Option<&TimerHandle>,
        every: Every,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.0.add(Numbering::Timers, |factory| {
            factory.timer(handle, every, callback)
        })
    }

    /// Calls `callback` whenever `guard` was triggered.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `guard` belongs to a callback already.
    pub fn guard<F, R>(self, guard: &GuardCondition, callback: F) -> Result<T::Added, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.0
            .add(Numbering::Guards, |factory| factory.guard(guard, callback))
    }

    /// Serves `name`: calls `callback` with every request and a response to fill, which is then
    /// sent. A reply that cannot be sent counts as an error of the handle. `name` is a name or a
    /// [`Topic`] with the largest size of requests and responses, for types with unbounded fields.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn serve<'t, S, F>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: F,
    ) -> Result<T::Added, Error>
    where
        S: Service,
        F: FnMut(&S::Request, &mut S::Response, &CallbackContext<'_>) + Send + 'static,
    {
        let mut response = S::Response::default();
        let called = move |request: &S::Request, to: Responder<S>, cx: &CallbackContext<'_>| {
            callback(request, &mut response, cx);
            to.reply(&response)
        };
        self.serve_later::<S, _, _>(node, name, qos, called)
    }

    /// Serves `name`: calls `callback` with every request and the right to answer it, now or
    /// later, from any thread.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn serve_later<'t, S, F, R>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        S: Service,
        F: FnMut(&S::Request, Responder<S>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let name = name.into();
        self.0.add(Numbering::None, |factory| {
            factory.server::<S, _, _>(node, name, qos, callback)
        })
    }

    /// Calls `callback` once for every request of `client`: with its reply, or with the reason why
    /// there is none, when its time limit has passed or what came is no such reply.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `client` belongs to a callback already; [`Error::ForeignNode`] if it
    /// is of another context than the executor's.
    pub fn replies<S, F, R>(self, client: &Client<S>, mut callback: F) -> Result<T::Added, Error>
    where
        S: Service,
        F: FnMut(Result<&S::Response, NoReply>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let called = move |reply: Result<&mut S::Response, NoReply>, cx: &CallbackContext<'_>| {
            callback(reply.map(|reply| &*reply), cx)
        };
        self.0
            .add(Numbering::None, |factory| factory.replies(client, called))
    }

    /// Serves `S`: `answer` reads the request's bytes and writes the response's.
    pub(crate) fn serve_bytes<S: Service>(
        self,
        node: &Node,
        name: Topic<'_>,
        answer: impl FnMut(&[u8], &mut CdrWriter<'_>) -> Result<(), Unanswered> + Send + 'static,
    ) -> Result<T::Added, Error> {
        let mut answer = answers::<S, _>(name, answer);
        let called =
            move |request: &Body<S::Request>, to: Responder<Bare<S>>, _: &CallbackContext<'_>| {
                answer(request.payload(), to)
            };
        self.serve_later::<Bare<S>, _, _>(node, name, Qos::services(), called)
    }

    /// A timer that belongs to something with a name: it does not count among the worker's.
    pub(crate) fn named_timer<F, R>(
        self,
        id: &str,
        handle: &TimerHandle,
        every: Every,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.0.add(Numbering::None, |factory| {
            factory.named_timer(id, handle, every, callback)
        })
    }

    /// Begins to add several handles that belong together: all of them, or none.
    pub(crate) fn together(self) -> AddHandles<T::Together> {
        AddHandles(self.0.together())
    }

    /// The next of several handles is the last one: all options apply to it.
    pub(crate) fn last(mut self) -> Self {
        self.0.next_is_last();
        self
    }

    /// The handles that belong together are there: the last one and `others` before it.
    pub(crate) fn all_added(self, others: u8) -> T::AllAdded {
        self.0.all_added(others)
    }

    /// Samples of the handle that was added last are delivered before replies of `client` that
    /// arrive later.
    pub(crate) fn ahead_of<S: Service>(mut self, client: &Client<S>) -> Self {
        if let Some(inbox) = self.0.last_inbox() {
            client.lets_ahead(&inbox);
        }
        self
    }
}
