//! Time as ROS has it: the wall clock, or that of a simulation for nodes with `use_sim_time`.

use super::clock::Release;
use crate::Nanos;
use crate::context::{Context, Node};
use crate::error::Error;
use crate::executor::wake::schedule::nanos;
use crate::executor::{
    AddHandles, CallbackContext, CallbackResult, Every, Executor, GuardCondition, Target,
};
use crate::platform::{text, wall_time};
use crate::qos::Qos;
use alloc::boxed::Box;
use core::time::Duration;
use replenish_interfaces::rosgraph_msgs::msg::Clock;
use replenish_msg::builtin_interfaces::Time;
use replenish_os::clock;
use std::sync::{Arc, Weak};

/// The longest time in which a wait does not notice a signal.
const SLICE: Duration = Duration::from_millis(100);

impl Node {
    /// Returns this moment in ROS time, for a header's stamp: the wall clock, or the last value of
    /// `/clock` if this node was started with the parameter `use_sim_time` (then zeros before the
    /// first message). Takes no lock and does not allocate.
    ///
    /// ```
    /// use replenish::Context;
    /// use replenish::interfaces::std_msgs::msg::Header;
    /// let node = Context::in_process().node("camera")?;
    /// let header = Header { stamp: node.now(), ..Header::default() };
    /// assert!(header.stamp.sec > 0);
    /// # Ok::<(), replenish::Error>(())
    /// ```
    #[must_use]
    pub fn now(&self) -> Time {
        if !self.uses_sim_time() {
            return wall_time();
        }
        let now = self.context().sim_clock().now();
        Time {
            sec: i32::try_from(now / 1_000_000_000).unwrap_or(i32::MAX),
            nanosec: u32::try_from(now % 1_000_000_000).unwrap_or(0),
        }
    }

    /// Whether its time is that of `/clock`: `-p use_sim_time:=true`, or a file of parameters.
    #[must_use]
    pub fn uses_sim_time(&self) -> bool {
        self.time().0
    }

    /// A loop of one's own, outside of callbacks, at `hertz` of ROS time.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a rate that is not above 0 Hz, up to 1 GHz.
    pub fn rate(&self, hertz: f64) -> Result<Rate, Error> {
        let period = Duration::try_from_secs_f64(1.0 / hertz).unwrap_or_default();
        if period.is_zero() {
            let (owner, allowed) = (text!("node {}", self.name()), "above 0 Hz to 1 GHz");
            return Err(Error::parameter(owner, "rate", &hertz, allowed));
        }
        let mut rate = Rate {
            node: self.clone(),
            period: nanos(period),
            seen: 0,
            next: 0,
        };
        rate.seen = rate.now();
        rate.next = rate.seen.saturating_add(rate.period);
        Ok(rate)
    }
}

/// A loop at a rate: [`Node::rate`]. The beats keep their grid; missed ones are left out.
#[derive(Debug)]
pub struct Rate {
    node: Node,
    period: Nanos,
    /// The time at the end of the last wait.
    seen: Nanos,
    next: Nanos,
}

impl Rate {
    /// Waits for the next beat. `false`: it was over already, or a signal has ended the wait
    /// ([`Context::ok`] says which). A clock that jumps backwards begins a new grid.
    ///
    /// For the program's own threads: a callback that waits keeps its worker from others.
    pub fn sleep(&mut self) -> bool {
        let mut now = self.now();
        if now >= self.next && now >= self.seen {
            let missed = (now - self.next) / self.period;
            let beats = missed.saturating_add(1).saturating_mul(self.period);
            self.next = self.next.saturating_add(beats);
            self.seen = now;
            return false;
        }
        while self.node.context().ok() {
            if now < self.seen {
                self.next = now.saturating_add(self.period);
            }
            self.seen = now;
            if now >= self.next {
                self.next = self.next.saturating_add(self.period);
                return true;
            }
            self.wait(now);
            now = self.now();
        }
        false
    }

    fn now(&self) -> Nanos {
        if self.node.uses_sim_time() {
            self.node.context().sim_clock().now()
        } else {
            clock::monotonic()
        }
    }

    fn wait(&self, now: Nanos) {
        if self.node.uses_sim_time() {
            self.node.context().sim_clock().wait(now, SLICE);
        } else {
            clock::sleep_until(self.next.min(now.saturating_add(nanos(SLICE))));
        }
    }
}

/// The callback's guard condition, and whether the callback is still there: it holds the other end.
struct Trigger(GuardCondition, Weak<()>);

impl Release for Trigger {
    fn release(&self) {
        self.0.trigger();
    }

    fn is_gone(&self) -> bool {
        self.1.strong_count() == 0
    }
}

impl<T: Target> AddHandles<T> {
    /// As [`timer`](Self::timer), on the time of `node`: a usual timer, or for a node with
    /// [`use_sim_time`](Node::uses_sim_time) one that follows `/clock`. It then begins with the
    /// first message; releases that one message brings count as one; a clock that jumps backwards
    /// starts it over. Its id is that of a guard condition. Budgets stay on CPU time.
    ///
    /// # Errors
    /// As `timer`; [`Error::Parameter`] for `not_started` and other rules for overruns than
    /// skipping if it follows `/clock`.
    pub fn ros_timer<F, R>(
        self,
        node: &Node,
        every: impl Into<Every>,
        callback: F,
    ) -> Result<T::Added, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        if !node.uses_sim_time() {
            return self.timer(every, callback);
        }
        let owner = || text!("timer of node {}", node.name());
        if every.period.is_zero() && !every.once {
            return Err(Error::parameter(owner(), "period", &0, "1 ns or more"));
        }
        let plain = every.overrun(crate::executor::Overrun::Skip);
        if !every.autostart || plain != every {
            let allowed = "a started timer that skips: its node follows /clock";
            return Err(Error::parameter(owner(), "every", &"set", allowed));
        }
        let guard = GuardCondition::new();
        let alive = Arc::new(());
        let token = Arc::downgrade(&alive);
        let mut callback = callback;
        let added = self.guard(&guard, move |cx| {
            let _alive = &alive;
            callback(cx)
        })?;
        let clock = node.context().sim_clock();
        clock.add(every, Box::new(Trigger(guard, token)));
        Ok(added)
    }
}

/// Adds the worker that follows `/clock` if a node of its context goes by it.
pub(crate) fn follow_clock(executor: &mut Executor) -> Result<(), Error> {
    let context: Context = executor.context.clone();
    let clock = context.sim_clock().clone();
    let Some(name) = clock.follower() else {
        return Ok(());
    };
    let node = context.existing(name)?;
    let set = clock.clone();
    executor.worker("ros_clock").subscribe(
        &node,
        "/clock",
        Qos::clock(),
        move |message: &Clock, _| {
            let Time { sec, nanosec } = message.clock;
            let seconds = u64::from(sec.unsigned_abs()) * u64::from(sec > 0);
            set.set(seconds * 1_000_000_000 + u64::from(nanosec));
        },
    )?;
    Ok(())
}
