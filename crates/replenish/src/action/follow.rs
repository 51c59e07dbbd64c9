//! Making an action's client, and adding it to a worker: three clients and two subscriptions.

use super::client::{ActionClient, GoalUpdate, Inner};
use super::server::GoalId;
use super::{ActionOptions, part, status_qos};
use crate::context::Node;
use crate::error::Error;
use crate::executor::{CallbackContext, CallbackResult, WorkerBuilder};
use crate::qos::Qos;
use crate::sync::{Arc, Mutex};
use replenish_msg::action::{Action, FeedbackMessage, GetResult, SendGoal};
use replenish_msg::action_msgs::{CancelGoal, GoalStatusArray};

impl Node {
    /// A client of the action `name`, which is expanded as topics are, with up to `options.goals`
    /// goals at a time.
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::Parameter`] for an option out of range, [`Error::Middleware`] when
    /// a part cannot be created.
    pub fn action_client<A: Action>(
        &self,
        name: &str,
        options: ActionOptions,
    ) -> Result<ActionClient<A>, Error> {
        let name = self.resolve(name)?;
        options.check(&name)?;
        let qos = options.services();
        let send = self.client(&part(&name, "send_goal"), qos, options.reply)?;
        let cancel = self.client(&part(&name, "cancel_goal"), qos, options.reply)?;
        let result = self.client(&part(&name, "get_result"), qos, options.result)?;
        let parts = (send, cancel, result);
        let (goals, depth) = (options.goals, options.feedback);
        Ok(ActionClient::new(self.clone(), name, parts, goals, depth))
    }
}

impl WorkerBuilder<'_> {
    /// Calls `callback` whenever something is heard of a goal of `client`: see [`GoalUpdate`].
    ///
    /// The client takes five handles of its worker; [`with`](Self::with) right behind this applies
    /// to the one that takes results.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `client` belongs to a callback already; [`Error::Middleware`] when a
    /// subscription cannot be created.
    pub fn follow<A, F, R>(self, client: &ActionClient<A>, callback: F) -> Result<Self, Error>
    where
        A: Action,
        F: FnMut(GoalId, GoalUpdate<'_, A>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let inner = &client.inner;
        // All on one worker, one after another: the lock is never contended.
        let callback = Arc::new(Mutex::new(callback));
        let part = || (Arc::clone(inner), Arc::clone(&callback));
        let feedback_qos = Qos::reliable().keep_last(inner.feedback_depth);
        let (to, tell) = part();
        let this = self.replies::<SendGoal<A>, _, _>(&inner.send, move |answer, cx| {
            let number = cx.request().number();
            to.answered(number, answer, |id, update| (tell.lock())(id, update, cx))
        })?;
        let (to, tell) = part();
        let this = this.replies::<CancelGoal, _, _>(&inner.cancel, move |answer, cx| {
            let number = cx.request().number();
            to.canceled(number, answer, |id, update| (tell.lock())(id, update, cx))
        })?;
        let (to, tell) = part();
        let this = this.subscribe(
            &inner.node,
            inner.part("feedback").as_str(),
            feedback_qos,
            move |message: &FeedbackMessage<A>, cx| {
                to.heard(message, |id, update| (tell.lock())(id, update, cx))
            },
        )?;
        let (to, tell) = part();
        let this = this.subscribe(
            &inner.node,
            inner.part("status").as_str(),
            status_qos(),
            move |all: &GoalStatusArray, cx| {
                to.states(all, |id, update| (tell.lock())(id, update, cx))
            },
        )?;
        let (to, tell) = part();
        this.replies::<GetResult<A>, _, _>(&inner.result, move |answer, cx| {
            let number = cx.request().number();
            to.ended(number, answer, |id, update| (tell.lock())(id, update, cx))
        })
    }
}

impl<A: Action> Inner<A> {
    fn part(&self, which: &str) -> alloc::string::String {
        part(&self.name, which)
    }
}
