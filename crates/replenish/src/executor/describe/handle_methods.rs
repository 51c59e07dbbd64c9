//! Adding handles to a worker that is described: one method for each kind.

use super::builder::WorkerBuilder;
use super::factory::RawType;
use super::topic::Topic;
use crate::context::Node;
use crate::error::Error;
use crate::executor::handles::callback::{CallbackContext, CallbackResult};
use crate::executor::handles::client::{Client, NoReply};
use crate::executor::handles::guard::GuardCondition;
use crate::executor::handles::service::Responder;
use crate::executor::handles::timer::TimerHandle;
use crate::executor::wake::schedule::Every;
use crate::qos::Qos;
use replenish_msg::{Message, Service, Viewed};

impl WorkerBuilder<'_> {
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
    ) -> Result<Self, Error>
    where
        M: Message,
        F: FnMut(&M, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        let called = move |message: Option<&M>, cx: &CallbackContext<'_>| {
            message.map(|message| callback(message, cx))
        };
        self.add(|factory| factory.subscription(node, topic, qos, called))
    }

    /// Calls `callback` in every round of this worker: with a new message on `topic`, or with
    /// `None`. What starts a round is up to the other handles, the [trigger](Self::trigger) and
    /// [`every`](Self::every).
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_always<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<Self, Error>
    where
        M: Message,
        F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.ruled(|_| {})
            .add(|factory| factory.always(node, topic, qos, callback))
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
    ) -> Result<Self, Error>
    where
        M: Viewed,
        F: FnMut(&M::View<'_>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|factory| factory.view::<M, _, _>(node, topic, qos, callback))
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
    ) -> Result<Self, Error>
    where
        F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|factory| factory.raw(node, topic, ty, qos, callback))
    }

    /// Calls `callback` at every release of a timer, given as a period or an [`Every`].
    ///
    /// Releases are absolute on the monotonic clock; the worker itself waits for them.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a period of 0.
    pub fn timer<F, R>(self, every: impl Into<Every>, callback: F) -> Result<Self, Error>
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
    ) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.timed(Some(handle), every, callback)
    }

    fn timed<F, R>(
        mut self,
        handle: Option<&TimerHandle>,
        every: Every,
        callback: F,
    ) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let number = self.spec().map_or(0, |s| {
            s.timers += 1;
            s.timers - 1
        });
        self.add_numbered(number, |factory| factory.timer(handle, every, callback))
    }

    /// Calls `callback` whenever `guard` was triggered.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `guard` belongs to a callback already.
    pub fn guard<F, R>(mut self, guard: &GuardCondition, callback: F) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let number = self.spec().map_or(0, |s| {
            s.guards += 1;
            s.guards - 1
        });
        self.add_numbered(number, |factory| factory.guard(guard, callback))
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
    ) -> Result<Self, Error>
    where
        S: Service,
        F: FnMut(&S::Request, &mut S::Response, &CallbackContext<'_>) + Send + 'static,
    {
        let mut response = S::Response::default();
        let called = move |request: &S::Request, to: Responder<S>, cx: &CallbackContext<'_>| {
            callback(request, &mut response, cx);
            to.reply(&response)
        };
        let name = name.into();
        self.add(|factory| factory.server::<S, _, _>(node, name, qos, called))
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
    ) -> Result<Self, Error>
    where
        S: Service,
        F: FnMut(&S::Request, Responder<S>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let name = name.into();
        self.add(|factory| factory.server::<S, _, _>(node, name, qos, callback))
    }

    /// Calls `callback` once for every request of `client`: with its reply, or with the reason why
    /// there is none, when its time limit has passed or what came is no such reply.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `client` belongs to a callback already; [`Error::ForeignNode`] if it
    /// is of another context than the executor's.
    pub fn replies<S, F, R>(self, client: &Client<S>, callback: F) -> Result<Self, Error>
    where
        S: Service,
        F: FnMut(Result<&S::Response, NoReply>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.add(|factory| factory.replies(client, callback))
    }
}
