//! Async callbacks: futures on a worker, under its policy and its budget.
//!
//! ```text
//!   subscribe_async, serve_async, timer_async:  input ──► callback makes a future ──► polled
//!   task: a future from the start                                                       │
//!                       ┌── ready: the handle takes its next input ◄────────────────────┤
//!                       └── pending: the worker runs other handles; woken ──► polled again
//! ```
//!
//! A handle has room for one future, on the heap since the handle was added: nothing allocates when
//! a future begins or ends. A poll is a callback: it is charged, counted and recorded like one.

use super::add::{AddHandles, Numbering, Target};
use super::topic::Topic;
use crate::context::Node;
use crate::error::Error;
use crate::executor::handles::asynchronous::{polled, put, room};
use crate::executor::handles::callback::{CallbackContext, CallbackResult};
use crate::executor::handles::guard::GuardCondition;
use crate::executor::wake::schedule::Every;
use crate::qos::Qos;
use crate::service::responder::Responder;
use core::future::Future;
use replenish_msg::{Message, Service};

impl<T: Target> AddHandles<T> {
    /// Runs a future on this worker, from its start until it is done. It is moved to the heap now;
    /// polling it allocates nothing of its own. Its id is that of a guard condition.
    ///
    /// ```
    /// # use replenish::msg::{Service, std_msgs::Int32};
    /// # use replenish::{CallError, Context, Error, Executor, Qos};
    /// # use std::time::Duration;
    /// # struct Double;
    /// # impl Service for Double {
    /// #     type Request = Int32;
    /// #     type Response = Int32;
    /// #     const TYPE_NAME: &'static str = "test_msgs/srv/Double";
    /// # }
    /// # fn main() -> Result<(), Error> {
    /// let ctx = Context::in_process();
    /// let node = ctx.node("n")?;
    /// let client = node.client::<Double>("double", Qos::services(), Duration::from_secs(1))?;
    /// let mut exec = Executor::new(&ctx);
    /// let stop = exec.stop_handle();
    /// exec.worker("server").serve::<Double, _>(&node, "double", Qos::services(), |n, twice, _| {
    ///     twice.data = 2 * n.data;
    /// })?;
    /// exec.worker("client").calls(&client)?.task(async move {
    ///     let twice = client.call_async(&Int32 { data: 21 }).await?;
    ///     assert_eq!(twice.data, 42);
    ///     stop.stop();
    ///     Ok::<(), CallError>(())
    /// })?;
    /// exec.spin()?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// None of its own.
    pub fn task<F, R>(self, future: F) -> Result<T::Added, Error>
    where
        F: Future<Output = R> + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.0.add(Numbering::Guards, |factory| {
            let room = room();
            put(&room, future);
            let entry = factory.guard(&GuardCondition::new(), |_: &CallbackContext<'_>| ())?;
            Ok(polled(entry, room))
        })
    }

    /// A future that belongs to something with a name: it does not count among the guard
    /// conditions.
    pub(crate) fn named_task<F, R>(self, id: &str, future: F) -> Result<T::Added, Error>
    where
        F: Future<Output = R> + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.0.add(Numbering::None, |factory| {
            let room = room();
            put(&room, future);
            let none = |_: &CallbackContext<'_>| ();
            let entry = factory.named_guard(id, &GuardCondition::new(), none)?;
            Ok(polled(entry, room))
        })
    }

    /// As [`subscribe`](Self::subscribe), with a callback that gives a future, for a message of its
    /// own. While the future waits the worker runs its other handles, and messages wait in the
    /// subscription as its quality says. A type with strings or sequences on the heap is cloned
    /// for each message, which allocates.
    ///
    /// # Errors
    /// As `subscribe`.
    pub fn subscribe_async<'t, M, C, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: C,
    ) -> Result<T::Added, Error>
    where
        M: Message + Clone,
        C: FnMut(M) -> F + Send + 'static,
        F: Future<Output = R> + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.0.add(Numbering::None, |factory| {
            let room = room();
            let to = room.clone();
            let called = move |message: Option<&M>, _: &CallbackContext<'_>| {
                if let Some(message) = message {
                    put(&to, callback(message.clone()));
                }
            };
            Ok(polled(
                factory.subscription(node, topic, qos, called)?,
                room,
            ))
        })
    }

    /// As [`serve`](Self::serve), with a callback that gives a future of the response. Requests
    /// that come meanwhile wait.
    ///
    /// # Errors
    /// As `serve`.
    pub fn serve_async<'t, S, C, F>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: C,
    ) -> Result<T::Added, Error>
    where
        S: Service<Request: Clone>,
        C: FnMut(S::Request) -> F + Send + 'static,
        F: Future<Output = S::Response> + Send + 'static,
    {
        let name = name.into();
        self.0.add(Numbering::None, |factory| {
            let room = room();
            let to = room.clone();
            let mut answer = move |request: S::Request, responder: Responder<S>| {
                let response = callback(request);
                async move { responder.reply(&response.await) }
            };
            let called = move |request: &S::Request, by: Responder<S>, _: &CallbackContext<'_>| {
                put(&to, answer(request.clone(), by));
            };
            Ok(polled(
                factory.server::<S, _, _>(node, name, qos, called)?,
                room,
            ))
        })
    }

    /// As [`timer`](Self::timer), with a callback that gives a future. Releases that come before
    /// the future is done are skipped, or caught up with as [`Every::overrun`] says.
    ///
    /// # Errors
    /// As `timer`.
    pub fn timer_async<C, F, R>(
        self,
        every: impl Into<Every>,
        mut callback: C,
    ) -> Result<T::Added, Error>
    where
        C: FnMut() -> F + Send + 'static,
        F: Future<Output = R> + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.0.add(Numbering::Timers, |factory| {
            let room = room();
            let to = room.clone();
            let called = move |_: &CallbackContext<'_>| put(&to, callback());
            Ok(polled(factory.timer(None, every, called)?, room))
        })
    }
}
