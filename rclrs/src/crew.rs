//! The threads of a runtime: begun by `create_worker`, woken by a spin, ended with the runtime.

use crate::payload::Found;
use crate::tasks::Task;
use crate::thread;
use rclrs::{GuardCondition, RclrsError, WaitSetRunConditions, WaitSetRunner};
use std::any::Any;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;

/// Something for the thread that spins.
pub(crate) enum Event {
    /// A task that can go on.
    Ready(Arc<Task>),
    /// A worker's spin has ended: with rclrs's answer, or with a callback's panic.
    Ended(Result<Result<(), RclrsError>, Box<dyn Any + Send>>),
}

struct Member {
    guard: Weak<GuardCondition>,
    spins: Sender<WaitSetRunConditions>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Members {
    all: Vec<Member>,
    /// The conditions of the spin that runs, and how many workers run in it.
    spin: Option<(WaitSetRunConditions, usize)>,
    /// Workers that were ever made, for names.
    made: usize,
    gone: bool,
}

/// Held for moments, by set-up, spin and halt; never while a callback runs.
pub(crate) struct Crew {
    members: Mutex<Members>,
    events: Sender<Event>,
}

impl Crew {
    pub(crate) fn new(events: Sender<Event>) -> Arc<Self> {
        Arc::new(Self {
            members: Mutex::default(),
            events,
        })
    }

    pub(crate) fn events(&self) -> &Sender<Event> {
        &self.events
    }

    fn members(&self) -> MutexGuard<'_, Members> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts a worker's thread, and lets it take part in a spin that runs already.
    pub(crate) fn begin(&self, runner: WaitSetRunner, found: Option<Found>) {
        let mut members = self.members();
        if members.gone {
            return;
        }
        let found = found.unwrap_or_else(|| Found {
            // The first one is the executor's own: node callbacks are taken there.
            name: format!("worker-{}", members.made),
            budget: None,
        });
        members.made += 1;
        let (spins, orders) = channel();
        let guard = Arc::downgrade(runner.guard_condition());
        let name = found.name.clone();
        let thread = match thread::start(runner, found, orders, self.events.clone()) {
            Ok(thread) => thread,
            Err(e) => {
                rclrs::log_fatal!("replenish", "no thread for worker {name:?}: {e}");
                return;
            }
        };
        if let Some((conditions, running)) = &mut members.spin
            && spins.send(conditions.clone()).is_ok()
        {
            *running += 1;
        }
        members.all.push(Member {
            guard,
            spins,
            thread: Some(thread),
        });
    }

    /// Begins a spin of all workers; whether there is any.
    pub(crate) fn spin(&self, conditions: &WaitSetRunConditions) -> bool {
        let mut members = self.members();
        // A thread whose callback panicked has ended.
        let starts = |m: &Member| m.spins.send(conditions.clone()).is_ok();
        let running = members.all.iter().filter(|m| starts(m)).count();
        members.spin = (running > 0).then(|| (conditions.clone(), running));
        running > 0
    }

    /// A worker's spin has ended; whether it was the last one.
    pub(crate) fn ended(&self) -> bool {
        let mut members = self.members();
        let Some((_, running)) = &mut members.spin else {
            return true;
        };
        *running -= 1;
        let last = *running == 0;
        if last {
            members.spin = None;
        }
        last
    }

    /// Wakes every wait set, so that a halt is seen.
    pub(crate) fn wake(&self) {
        let mut members = self.members();
        members.all.retain(|member| match member.guard.upgrade() {
            Some(guard) => {
                if let Err(e) = guard.trigger() {
                    rclrs::log_fatal!("replenish", "a guard condition cannot be triggered: {e}");
                }
                true
            }
            None => false,
        });
    }

    /// Ends all threads, which are not in a spin; their budgets have ended then.
    pub(crate) fn end(&self) {
        let all = {
            let mut members = self.members();
            members.gone = true;
            std::mem::take(&mut members.all)
        };
        for mut member in all {
            drop(member.spins);
            if let Some(thread) = member.thread.take()
                && thread.thread().id() != std::thread::current().id()
            {
                thread.join().ok(); // a panic was handed to the spin
            }
        }
    }
}
