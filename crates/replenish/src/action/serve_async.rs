//! An action's server whose goals are futures: one handle of the worker polls those of all goals.
//!
//! ```text
//!   send_goal ── accept? ──► Offered ──► Pursuit: a room for each goal ── polled ──► its result
//!                   │           └ wakes ───► │                                          │
//!                   └ no: rejected           └── dropped with its worker: aborted       └► ended
//! ```

use super::ActionOptions;
use super::goal::{GoalHandle, GoalId, NewGoal};
use super::goal_error::GoalError;
use super::server_core::Core;
use super::state::{GoalEvent, GoalState};
use super::table::Ticket;
use crate::context::Node;
use crate::error::Error;
use crate::executor::{AddHandles, CallbackContext, Target, Topic};
use crate::sync::{Arc, Mutex};
use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::fmt;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, Waker};
use replenish_msg::action::Action;

/// A goal as the future sees it that pursues it: [`WorkerBuilder::serve_action_async`].
///
/// [`WorkerBuilder::serve_action_async`]: crate::WorkerBuilder::serve_action_async
pub struct RunningGoal<A: Action> {
    core: Arc<Core<A>>,
    ticket: Ticket,
    id: GoalId,
}

impl<A: Action> RunningGoal<A> {
    /// The goal's id.
    #[must_use]
    pub fn id(&self) -> GoalId {
        self.id
    }

    /// Whether a client has asked to cancel the goal: check it after each wait, and return the
    /// result so far when that is safe.
    #[must_use]
    pub fn is_canceling(&self) -> bool {
        self.core.state.lock().table.state(self.ticket) == Some(GoalState::Canceling)
    }

    /// Publishes how far the goal has come. Does not allocate.
    ///
    /// # Errors
    /// [`GoalError::Send`].
    pub fn feedback(&self, feedback: &A::Feedback) -> Result<(), GoalError> {
        self.core.publish(self.ticket, self.id, feedback)
    }
}

impl<A: Action> fmt::Debug for RunningGoal<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RunningGoal({})", self.id)
    }
}

/// Accepted goals on their way to the future that pursues them.
struct Offered<A: Action> {
    goals: VecDeque<(A::Goal, GoalHandle<A>)>,
    waker: Option<Waker>,
}

/// The futures of all goals.
struct Pursuit<A: Action, C, F> {
    offered: Arc<Mutex<Offered<A>>>,
    core: Arc<Core<A>>,
    pursue: Box<C>,
    rooms: Vec<Room<A, F>>,
}

/// The place of one goal. The goal is aborted with its handle if its future does not end.
struct Room<A: Action, F> {
    future: Pin<Box<Option<F>>>,
    goal: Option<GoalHandle<A>>,
}

impl<A, C, F> Pursuit<A, C, F>
where
    A: Action,
    C: FnMut(A::Goal, RunningGoal<A>) -> F,
    F: Future<Output = Result<A::Result, A::Result>>,
{
    /// The next goal that was accepted; without one, `waker` is woken by it.
    fn next(&self, waker: &Waker) -> Option<(A::Goal, GoalHandle<A>)> {
        let mut offered = self.offered.lock();
        let goal = offered.goals.pop_front();
        if goal.is_none() && !offered.waker.as_ref().is_some_and(|w| w.will_wake(waker)) {
            offered.waker = Some(waker.clone());
        }
        goal
    }

    /// Gives the goals that have come a room each. There are as many as goals can be open.
    fn take_in(&mut self, waker: &Waker) {
        while let Some(room) = self.rooms.iter().position(|room| room.goal.is_none())
            && let Some((goal, handle)) = self.next(waker)
        {
            let running = RunningGoal {
                core: Arc::clone(&self.core),
                ticket: handle.ticket,
                id: handle.id,
            };
            let future = (self.pursue)(goal, running);
            if let Some(room) = self.rooms.get_mut(room) {
                room.future.as_mut().set(Some(future));
                room.goal = Some(handle);
            }
        }
    }
}

impl<A, F> Room<A, F>
where
    A: Action,
    F: Future<Output = Result<A::Result, A::Result>>,
{
    /// Polls the future, and ends the goal with it; whether it has ended.
    fn poll(&mut self, cx: &mut Context<'_>) -> Result<bool, GoalError> {
        let Some(future) = self.future.as_mut().as_pin_mut() else {
            return Ok(false);
        };
        let Poll::Ready(outcome) = future.poll(cx) else {
            return Ok(false);
        };
        self.future.as_mut().set(None);
        let Some(goal) = self.goal.take() else {
            return Ok(true);
        };
        let ended = match outcome {
            Ok(result) => match goal.canceled(&result) {
                Err(GoalError::State {
                    event: GoalEvent::Canceled,
                    ..
                }) => goal.succeed(&result),
                ended => ended,
            },
            Err(result) => goal.abort(&result),
        };
        ended.map(|()| true)
    }
}

impl<A, C, F> Future for Pursuit<A, C, F>
where
    A: Action,
    C: FnMut(A::Goal, RunningGoal<A>) -> F,
    F: Future<Output = Result<A::Result, A::Result>>,
{
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = &mut *self;
        loop {
            this.take_in(cx.waker());
            let mut ended = false;
            for room in &mut this.rooms {
                match room.poll(cx) {
                    Ok(end) => ended |= end,
                    Err(why) => {
                        this.core.fail(why);
                        ended = true;
                    }
                }
            }
            if !ended {
                return Poll::Pending; // a room that became free may have been waited for
            }
        }
    }
}

/// Room for `goals` accepted goals.
fn offered<A: Action>(goals: usize) -> Arc<Mutex<Offered<A>>> {
    Arc::new(Mutex::new(Offered {
        goals: VecDeque::with_capacity(goals),
        waker: None,
    }))
}

impl<T: Target> AddHandles<T> {
    /// Serves the action `name` with a future for each goal: up to `options.goals` at a time, on
    /// this worker, under its budget. `accept` says whether a goal is pursued at all. A request to
    /// cancel is always granted: [`RunningGoal::is_canceling`] then says so.
    ///
    /// The future's output ends the goal: `Ok` with the result of a goal that has succeeded, or, if
    /// it is being canceled, was canceled; `Err` with the result of one that is aborted. A future
    /// that is dropped with its worker aborts its goal.
    ///
    /// The places for goals and their futures are on the heap from the start. A goal with strings
    /// or sequences on the heap is cloned for its future, which allocates. An answer that cannot be
    /// sent is an error of the handle `…/expiry`. The server takes five handles; of their
    /// [`options`](crate::WorkerBuilder::options) those of [`serve_action`](Self::serve_action)
    /// hold.
    ///
    /// ```
    /// # use replenish::{ActionOptions, Context, Error, Executor, RunningGoal, sleep};
    /// # use replenish::msg::{Action, std_msgs::Int32};
    /// # use std::time::Duration;
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
    /// exec.worker("count").serve_action_async(
    ///     &node,
    ///     "count",
    ///     ActionOptions::goals(4),
    ///     |goal: &Int32| goal.data >= 0,
    ///     |goal, running: RunningGoal<Count>| async move {
    ///         let mut count = Int32::default();
    ///         while count.data < goal.data && !running.is_canceling() {
    ///             sleep(Duration::from_millis(100)).await;
    ///             count.data += 1;
    ///             running.feedback(&count).map_err(|_| count.clone())?;
    ///         }
    ///         Ok(count)
    ///     },
    /// )?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`serve_action`](Self::serve_action).
    pub fn serve_action_async<'t, A, G, C, F>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        options: ActionOptions,
        mut accept: G,
        pursue: C,
    ) -> Result<T::AllAdded, Error>
    where
        A: Action<Goal: Clone>,
        G: FnMut(&A::Goal) -> bool + Send + 'static,
        C: FnMut(A::Goal, RunningGoal<A>) -> F + Send + 'static,
        F: Future<Output = Result<A::Result, A::Result>> + Send + 'static,
    {
        let topic = name.into();
        let server = super::serve::Server::<A>::new(node, &topic, options)?;
        let offered = offered::<A>(server.goals());
        let room = || Room {
            future: Box::pin(None),
            goal: None,
        };
        let pursuit = Pursuit {
            offered: Arc::clone(&offered),
            core: Arc::clone(&server.core),
            pursue: Box::new(pursue),
            rooms: core::iter::repeat_with(room).take(server.goals()).collect(),
        };
        let goal = move |goal: &A::Goal, new: NewGoal<A>, _: &CallbackContext<'_>| {
            if !accept(goal) {
                return new.reject();
            }
            let handle = new.accept()?;
            let mut offered = offered.lock();
            offered.goals.push_back((goal.clone(), handle));
            let waker = offered.waker.clone();
            drop(offered);
            if let Some(waker) = waker {
                waker.wake();
            }
            Ok(())
        };
        let id = server.id(node, "task", "goals");
        let worker = self.together().named_task(&id, pursuit)?;
        let worker = server.add(worker, node, goal, |_, _| true)?;
        Ok(worker.all_added(4))
    }
}
