//! Making an action's client, and adding it to a worker: three clients and two subscriptions.

use super::client::{ActionClient, GoalUpdate, Inner, Several};
use super::goal::GoalId;
use super::{ActionOptions, part, status_qos};
use crate::context::Node;
use crate::error::Error;
use crate::executor::{AddHandles, CallbackContext, CallbackResult, OneUser, Target, Topic};
use crate::qos::Qos;
use crate::service::error::NoReply;
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::string::String;
use replenish_msg::Service;
use replenish_msg::action::{
    Action, FeedbackMessage, GetResult, GetResultResponse, SendGoal, SendGoalRequest,
};
use replenish_msg::action_msgs::{CancelGoal, GoalStatusArray};

impl Node {
    /// A client of the action `name`, which is expanded as topics are, with up to `options.goals`
    /// goals at a time. A [`Topic`] says the largest size of its messages, too.
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::Parameter`] for an option or size out of range,
    /// [`Error::Middleware`] when a part cannot be created.
    pub fn action_client<'t, A: Action>(
        &self,
        name: impl Into<Topic<'t>>,
        options: ActionOptions,
    ) -> Result<ActionClient<A>, Error> {
        let topic = name.into();
        let (name, options) = options.of(self, &topic)?;
        let qos = options.services();
        let (send, result) = (part(&name, "send_goal"), part(&name, "get_result"));
        let send = options.topic::<SendGoalRequest<A>>(&send);
        let result = options.topic::<GetResultResponse<A>>(&result);
        let send = self.client(send, qos, options.reply)?;
        let cancel = self.client(&part(&name, "cancel_goal"), qos, options.reply)?;
        let result = self.client(result, qos, options.result)?;
        let parts = (send, cancel, result);
        Ok(ActionClient::new(self.clone(), name, parts, options))
    }
}

impl<T: Target> AddHandles<T> {
    /// Calls `callback` with the news of `client`'s goals: see [`GoalUpdate`]. Feedback that
    /// arrived before a result is reported before it, except over RTPS: there each of them has a
    /// port of its own, and a result may overtake the last feedback, which is then not reported.
    ///
    /// The client takes five handles of its worker. Of its
    /// [`options`](crate::WorkerBuilder::options), priority, group and error hook apply to all of
    /// them, a deadline to the one that takes results.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `client` belongs to a callback already; [`Error::Middleware`] when a
    /// subscription cannot be created. Nothing was added then to a worker that runs, and the client
    /// cannot be used.
    pub fn follow<A, F, R>(
        self,
        client: &ActionClient<A>,
        callback: F,
    ) -> Result<T::AllAdded, Error>
    where
        A: Action,
        F: FnMut(GoalId, GoalUpdate<'_, A>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let inner = &client.inner;
        let parts = Parts::new(inner, callback);
        let (feedback, feedback_qos) = inner.feedback();
        let (status, status_qos) = inner.status();
        let worker = self
            .together()
            .replies(&inner.send, parts.accepted())?
            .replies(&inner.cancel, parts.canceled())?
            .subscribe(
                &inner.node,
                inner.options.topic::<FeedbackMessage<A>>(&feedback),
                feedback_qos,
                parts.feedback(),
            )?
            .ahead_of(&inner.result)
            .subscribe(&inner.node, status.as_str(), status_qos, parts.status())?
            .last()
            .replies(&inner.result, parts.results())?;
        Ok(worker.all_added(4))
    }
}

impl<A: Action> Inner<A> {
    fn feedback(&self) -> (String, Qos) {
        let qos = Qos::reliable().keep_last(self.options.feedback);
        (part(&self.name, "feedback"), qos)
    }

    fn status(&self) -> (String, Qos) {
        (part(&self.name, "status"), status_qos())
    }
}

/// The user's callback, which is too large to be moved for each call.
type Callback<F> = Arc<OneUser<Box<F>>>;

/// The callbacks of a client's handles, made of the user's one.
struct Parts<A: Action, F> {
    inner: Arc<Inner<A>>,
    /// All are on one worker and call it one after another.
    callback: Callback<F>,
}

impl<A, F, R> Parts<A, F>
where
    A: Action,
    F: FnMut(GoalId, GoalUpdate<'_, A>, &CallbackContext<'_>) -> R + Send + 'static,
    R: CallbackResult + 'static,
{
    fn new(inner: &Arc<Inner<A>>, callback: F) -> Self {
        Self {
            inner: Arc::clone(inner),
            callback: Arc::new(OneUser::new(Box::new(callback))),
        }
    }

    fn ends(&self) -> (Arc<Inner<A>>, Callback<F>) {
        (Arc::clone(&self.inner), Arc::clone(&self.callback))
    }

    fn accepted(
        &self,
    ) -> impl FnMut(Reply<'_, SendGoal<A>>, &CallbackContext<'_>) -> Option<R> + Send + use<A, F, R>
    {
        let (to, tell) = self.ends();
        move |answer, cx| {
            let number = cx.request().number();
            to.answered(number, answer, |id, update| {
                tell.with(|tell| tell(id, update, cx))
            })
        }
    }

    fn canceled(
        &self,
    ) -> impl FnMut(Reply<'_, CancelGoal>, &CallbackContext<'_>) -> Option<R> + Send + use<A, F, R>
    {
        let (to, tell) = self.ends();
        move |answer, cx| {
            let number = cx.request().number();
            to.canceled(number, answer, |id, update| {
                tell.with(|tell| tell(id, update, cx))
            })
        }
    }

    fn results(
        &self,
    ) -> impl FnMut(Reply<'_, GetResult<A>>, &CallbackContext<'_>) -> Option<R> + Send + use<A, F, R>
    {
        let (to, tell) = self.ends();
        move |answer, cx| {
            let number = cx.request().number();
            to.ended(number, answer, |id, update| {
                tell.with(|tell| tell(id, update, cx))
            })
        }
    }

    fn feedback(
        &self,
    ) -> impl FnMut(&FeedbackMessage<A>, &CallbackContext<'_>) -> Several<Option<R>> + Send + use<A, F, R>
    {
        let (to, tell) = self.ends();
        move |message, cx| to.heard(message, |id, update| tell.with(|tell| tell(id, update, cx)))
    }

    fn status(
        &self,
    ) -> impl FnMut(&GoalStatusArray, &CallbackContext<'_>) -> Several<Option<R>> + Send + use<A, F, R>
    {
        let (to, tell) = self.ends();
        move |all, cx| to.states(all, |id, update| tell.with(|tell| tell(id, update, cx)))
    }
}

/// The argument of a callback for replies of `S`.
type Reply<'a, S> = Result<&'a <S as Service>::Response, NoReply>;
