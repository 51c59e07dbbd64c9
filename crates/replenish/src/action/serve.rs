//! Adding an action's server to a worker: three services and a timer.

use super::goal::{GoalId, NewGoal};
use super::server_core::Core;
use super::{ActionOptions, part, status_qos};
use crate::context::Node;
use crate::error::Error;
use crate::executor::{
    AddHandles, CallbackContext, CallbackResult, Every, Target, TimerHandle, Topic, nanos,
};
use crate::middleware::PublishError;
use crate::qos::Qos;
use crate::service::responder::Responder;
use crate::sync::Arc;
use alloc::string::String;
use core::fmt;
use core::time::Duration;
use replenish_msg::Message;
use replenish_msg::action::{
    Action, FeedbackMessage, GetResult, GetResultResponse, SendGoal, SendGoalRequest,
};
use replenish_msg::action_msgs::{CancelGoal, CancelGoalRequest, CancelGoalResponse};

impl<T: Target> AddHandles<T> {
    /// Serves the action `name`, with up to `options.goals` goals at a time. A [`Topic`] says the
    /// largest size of its messages, too.
    ///
    /// `goal` is called with every goal that comes and the right to [accept](NewGoal::accept) it,
    /// now or later; what it returns by that is a [`GoalHandle`](crate::GoalHandle), with which the
    /// goal is pursued from wherever you like: a timer of this worker, another worker, a thread.
    /// `cancel` is called for each goal that a client wants to cancel, and decides. The goal then
    /// [is canceling](crate::GoalHandle::is_canceling), and ends when its pursuer ends it.
    ///
    /// A goal for which there is no room is rejected without asking, counted and reported as an
    /// error of the handle `…/send_goal`. The server takes four handles of its worker. Of its
    /// [`options`](crate::WorkerBuilder::options), priority, group and error hook apply to all of
    /// them, a deadline to the one that calls `goal`. The action goes when all four are
    /// [removed](crate::ExecutorHandle::remove); goals that are pursued then go on unheard.
    ///
    /// ```
    /// # use replenish::{ActionOptions, Context, Error, Executor, NewGoal};
    /// # use replenish::msg::{Action, std_msgs::Int32};
    /// # struct Count;
    /// # impl Action for Count {
    /// #     type Goal = Int32;
    /// #     type Result = Int32;
    /// #     type Feedback = Int32;
    /// #     const TYPE_NAME: &'static str = "demo/action/Count";
    /// #     const DDS_TYPE_NAME: &'static str = "demo::action::dds_::Count_";
    /// # }
    /// # fn main() -> Result<(), Error> {
    /// # let ctx = Context::in_process();
    /// # let node = ctx.node("n")?;
    /// # let mut exec = Executor::new(&ctx);
    /// exec.worker("count").serve_action(
    ///     &node,
    ///     "count",
    ///     ActionOptions::goals(4),
    ///     |goal: &Int32, new: NewGoal<Count>, _| match goal.data {
    ///         0.. => new.accept()?.succeed(goal), // no sooner said than done
    ///         _ => new.reject(),
    ///     },
    ///     |_, _| true,
    /// )?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::ForeignNode`], [`Error::Parameter`] for an option out of range,
    /// [`Error::Middleware`] when a part cannot be created.
    pub fn serve_action<'t, A, G, C, R>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        options: ActionOptions,
        goal: G,
        cancel: C,
    ) -> Result<T::AllAdded, Error>
    where
        A: Action,
        G: FnMut(&A::Goal, NewGoal<A>, &CallbackContext<'_>) -> R + Send + 'static,
        C: FnMut(GoalId, &CallbackContext<'_>) -> bool + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = name.into();
        let server = Server::<A>::new(node, &topic, options)?;
        let worker = server.add(self.together(), node, goal, cancel)?;
        Ok(worker.all_added(3))
    }
}

/// A server whose handles are to be added.
pub(super) struct Server<A: Action> {
    pub(super) core: Arc<Core<A>>,
    options: ActionOptions,
    timer: TimerHandle,
}

impl<A: Action> Server<A> {
    pub(super) fn new(
        node: &Node,
        topic: &Topic<'_>,
        options: ActionOptions,
    ) -> Result<Self, Error> {
        let timer = TimerHandle::new();
        let (name, options) = options.of(node, topic)?;
        let core = core::<A>(node, name, options, timer.clone())?;
        Ok(Self {
            core,
            options,
            timer,
        })
    }

    /// The most goals at a time.
    pub(super) fn goals(&self) -> usize {
        self.options.goals
    }

    /// The id of a handle that has no topic.
    pub(super) fn id(&self, node: &Node, kind: &str, which: &str) -> String {
        alloc::format!("{}/{kind}:{}", node.name(), self.core.part(which))
    }

    /// Adds the four handles that every server has.
    pub(super) fn add<T, G, C, R>(
        &self,
        worker: AddHandles<T>,
        node: &Node,
        goal: G,
        cancel: C,
    ) -> Result<AddHandles<T>, Error>
    where
        T: Target<Added = AddHandles<T>>,
        G: FnMut(&A::Goal, NewGoal<A>, &CallbackContext<'_>) -> R + Send + 'static,
        C: FnMut(GoalId, &CallbackContext<'_>) -> bool + Send + 'static,
        R: CallbackResult + 'static,
    {
        let Self {
            core,
            options,
            timer,
        } = self;
        let qos = options.services();
        let (ends, begins) = (core.part("get_result"), core.part("send_goal"));
        let ends = options.topic::<GetResultResponse<A>>(&ends);
        let begins = options.topic::<SendGoalRequest<A>>(&begins);
        worker
            .named_timer(&self.id(node, "timer", "expiry"), timer, OFF, expiry(core))?
            .serve_later::<GetResult<A>, _, _>(node, ends, qos, results(core))?
            .serve_later::<CancelGoal, _, _>(
                node,
                &core.part("cancel_goal"),
                qos,
                cancels(core, cancel),
            )?
            .last()
            .serve_later::<SendGoal<A>, _, _>(node, begins, qos, goals(core, goal))
    }
}

/// The timer is started when there is something to expire.
const OFF: Every = Every::once(Duration::from_secs(1)).not_started();

/// Everything but the handles.
fn core<A: Action>(
    node: &Node,
    name: String,
    options: ActionOptions,
    timer: TimerHandle,
) -> Result<Arc<Core<A>>, Error> {
    let feedback = part(&name, "feedback");
    let feedback = options.topic::<FeedbackMessage<A>>(&feedback);
    let feedback = node.publisher(feedback, Qos::reliable())?;
    let status = node.publisher(&part(&name, "status"), status_qos())?;
    let size = options.size::<GetResultResponse<A>>();
    let size = size.unwrap_or(GetResultResponse::<A>::MAX_SIZE);
    let sizes = (options.goals, options.askers, size);
    let keep = nanos(options.keep);
    Ok(Core::new(name, sizes, keep, feedback, status, timer))
}

impl<A: Action> Core<A> {
    fn part(&self, which: &str) -> alloc::string::String {
        part(&self.name, which)
    }
}

fn expiry<A: Action>(
    core: &Arc<Core<A>>,
) -> impl FnMut(&CallbackContext<'_>) -> Result<(), super::GoalError> + Send + use<A> {
    let core = Arc::clone(core);
    move |_| core.look_after()
}

fn results<A: Action>(
    core: &Arc<Core<A>>,
) -> impl FnMut(
    &replenish_msg::action::GetResultRequest<A>,
    Responder<GetResult<A>>,
    &CallbackContext<'_>,
) -> Result<(), super::GoalError>
+ Send
+ use<A> {
    let core = Arc::clone(core);
    move |request, to, _| core.ask(request.goal_id, to)
}

fn cancels<A, C>(
    core: &Arc<Core<A>>,
    mut willing: C,
) -> impl FnMut(
    &CancelGoalRequest,
    Responder<CancelGoal>,
    &CallbackContext<'_>,
) -> Result<(), PublishError>
+ Send
+ use<A, C>
where
    A: Action,
    C: FnMut(GoalId, &CallbackContext<'_>) -> bool + Send,
{
    let core = Arc::clone(core);
    let mut answer = CancelGoalResponse::default();
    move |request, to, cx| {
        core.cancel(request, &mut answer, |id| willing(id, cx));
        to.reply(&answer)
    }
}

fn goals<A, G, R>(
    core: &Arc<Core<A>>,
    mut goal: G,
) -> impl FnMut(&SendGoalRequest<A>, Responder<SendGoal<A>>, &CallbackContext<'_>) -> Outcome<R>
+ Send
+ use<A, G, R>
where
    A: Action,
    G: FnMut(&A::Goal, NewGoal<A>, &CallbackContext<'_>) -> R + Send,
{
    let core = Arc::clone(core);
    move |request, to, cx| match Core::offer(&core, request.goal_id, to) {
        Ok(new) => Outcome::Called(goal(&request.goal, new, cx)),
        Err(e) => Outcome::Refused(e),
    }
}

/// The fate of a goal that came.
enum Outcome<R> {
    /// The user's callback has returned this.
    Called(R),
    /// It was not called.
    Refused(super::GoalError),
}

impl<R: CallbackResult> CallbackResult for Outcome<R> {
    fn inspect(self, report: &mut dyn FnMut(&dyn fmt::Display)) {
        match self {
            Self::Called(result) => result.inspect(report),
            Self::Refused(e) => report(&e),
        }
    }
}
