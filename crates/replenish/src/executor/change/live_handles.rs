//! Adding handles to a worker that runs: one method for each kind, as for one that is described.

use super::live::WorkerHandle;
use crate::context::Node;
use crate::error::Error;
use crate::executor::describe::factory::RawType;
use crate::executor::describe::topic::Topic;
use crate::executor::handles::callback::{CallbackContext, CallbackResult};
use crate::executor::handles::client::{Client, NoReply};
use crate::executor::handles::guard::GuardCondition;
use crate::executor::handles::service::Responder;
use crate::executor::handles::timer::TimerHandle;
use crate::executor::wake::schedule::Every;
use crate::qos::Qos;
use alloc::string::String;
use replenish_msg::{Message, Service, Viewed};

#[expect(clippy::missing_errors_doc, reason = "said once, at the type")]
impl WorkerHandle<'_> {
    /// A subscription.
    pub fn subscribe<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: F,
    ) -> Result<String, Error>
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

    /// A subscription whose callback runs in every round of the worker from now on.
    pub fn subscribe_always<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<String, Error>
    where
        M: Message,
        F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|factory| factory.always(node, topic, qos, callback))
    }

    /// A subscription to views.
    pub fn subscribe_view<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<String, Error>
    where
        M: Viewed,
        F: FnMut(&M::View<'_>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|factory| factory.view::<M, _, _>(node, topic, qos, callback))
    }

    /// A subscription to bytes.
    pub fn subscribe_raw<'t, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        ty: RawType<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<String, Error>
    where
        F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|factory| factory.raw(node, topic, ty, qos, callback))
    }

    /// A timer, which counts from now.
    pub fn timer<F, R>(self, every: impl Into<Every>, callback: F) -> Result<String, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.add(|factory| factory.timer(None, every, callback))
    }

    /// A timer that counts from now, with a handle.
    pub fn timer_with<F, R>(
        self,
        handle: &TimerHandle,
        every: impl Into<Every>,
        callback: F,
    ) -> Result<String, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.add(|factory| factory.timer(Some(handle), every, callback))
    }

    /// A guard condition.
    pub fn guard<F, R>(self, guard: &GuardCondition, callback: F) -> Result<String, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.add(|factory| factory.guard(guard, callback))
    }

    /// A service that answers in the callback.
    pub fn serve<'t, S, F>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: F,
    ) -> Result<String, Error>
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

    /// A service that answers now or later.
    pub fn serve_later<'t, S, F, R>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<String, Error>
    where
        S: Service,
        F: FnMut(&S::Request, Responder<S>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let name = name.into();
        self.add(|factory| factory.server::<S, _, _>(node, name, qos, callback))
    }

    /// The replies of a client.
    pub fn replies<S, F, R>(self, client: &Client<S>, callback: F) -> Result<String, Error>
    where
        S: Service,
        F: FnMut(Result<&S::Response, NoReply>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.add(|factory| factory.replies(client, callback))
    }
}
