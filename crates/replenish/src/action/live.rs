//! Actions on workers that run: several handles at once, or none.

use super::client::{ActionClient, GoalUpdate};
use super::goal::{GoalId, NewGoal};
use super::{ActionOptions, follow, serve};
use crate::context::Node;
use crate::error::Error;
use crate::executor::{CallbackContext, CallbackResult, HandleGroup, TimerHandle, WorkerHandle};
use alloc::string::String;
use alloc::vec::Vec;
use replenish_msg::action::{
    Action, FeedbackMessage, GetResult, GetResultResponse, SendGoal, SendGoalRequest,
};
use replenish_msg::action_msgs::CancelGoal;

impl WorkerHandle<'_> {
    /// Serves an action; the ids of its four handles. The action goes when all are
    /// [removed](crate::ExecutorHandle::remove); goals that are pursued then go on, and nobody
    /// hears of them.
    ///
    /// # Errors
    /// As [`WorkerBuilder::serve_action`](crate::WorkerBuilder::serve_action), and those of this
    /// type; nothing was added then.
    pub fn serve_action<A, G, C, R>(
        self,
        node: &Node,
        name: &str,
        options: ActionOptions,
        goal: G,
        cancel: C,
    ) -> Result<Vec<String>, Error>
    where
        A: Action,
        G: FnMut(&A::Goal, NewGoal<A>, &CallbackContext<'_>) -> R + Send + 'static,
        C: FnMut(GoalId, &CallbackContext<'_>) -> bool + Send + 'static,
        R: CallbackResult + 'static,
    {
        let timer = TimerHandle::new();
        let core = serve::core::<A>(node, name, options, timer.clone())?;
        let qos = options.services();
        let mut added = HandleGroup::to(&self);
        added.keep(
            self.again()
                .timer_with(&timer, serve::OFF, serve::expiry(&core)),
        )?;
        let results = serve::results(&core);
        let part = core.part("get_result");
        let part = options.topic::<GetResultResponse<A>>(&part);
        added.keep(
            self.again()
                .serve_later::<GetResult<A>, _, _>(node, part, qos, results),
        )?;
        let cancels = serve::cancels(&core, cancel);
        let part = core.part("cancel_goal");
        added.keep(
            self.again()
                .serve_later::<CancelGoal, _, _>(node, &part, qos, cancels),
        )?;
        let goals = serve::goals(&core, goal);
        let part = core.part("send_goal");
        let part = options.topic::<SendGoalRequest<A>>(&part);
        added.keep(self.serve_later::<SendGoal<A>, _, _>(node, part, qos, goals))?;
        Ok(added.done())
    }

    /// Calls `callback` whenever something is heard of a goal of `client`; the ids of the five
    /// handles.
    ///
    /// # Errors
    /// As [`WorkerBuilder::follow`](crate::WorkerBuilder::follow), and those of this type; nothing
    /// was added then, and the client cannot be used.
    pub fn follow<A, F, R>(
        self,
        client: &ActionClient<A>,
        callback: F,
    ) -> Result<Vec<String>, Error>
    where
        A: Action,
        F: FnMut(GoalId, GoalUpdate<'_, A>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let inner = &client.inner;
        let parts = follow::Parts::new(inner, callback);
        let mut added = HandleGroup::to(&self);
        added.keep(self.again().replies(&inner.send, parts.accepted()))?;
        added.keep(self.again().replies(&inner.cancel, parts.canceled()))?;
        let (topic, qos) = inner.feedback();
        let feedback = parts.feedback();
        let topic = inner.options.topic::<FeedbackMessage<A>>(&topic);
        added.keep(self.again().subscribe(&inner.node, topic, qos, feedback))?;
        added.put_ahead_of(&inner.result);
        let (topic, qos) = inner.status();
        let status = parts.status();
        added.keep(
            self.again()
                .subscribe(&inner.node, topic.as_str(), qos, status),
        )?;
        added.keep(self.replies(&inner.result, parts.results()))?;
        Ok(added.done())
    }
}
