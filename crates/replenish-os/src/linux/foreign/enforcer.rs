//! The enforcer of foreign threads: started, asked and stopped from any thread.

use super::error::ForeignError;
use super::freezer::Freezer;
use super::group::{Group, MOST_EVENTS};
use super::groups::{Groups, MOST_BUDGETS};
use super::member::{Classes, Member};
use super::processes::is_zombie;
use super::state::State;
use super::thread::ForeignThread;
use super::usage::{BudgetId, BudgetUsage, Figures, Inspection, ThreadUsage};
use crate::enforcer::alarm::Alarm;
use crate::linux::affinity::{CpuSet, set_affinity};
use crate::linux::clock::{self, ThreadCpuClock};
use crate::linux::config::ENFORCER_STACK;
use crate::linux::console::complain;
use crate::linux::context_switches::ContextSwitchLog;
use crate::linux::memory::{self, LockError};
use crate::linux::sched::SchedClass;
use crate::linux::spawn_error::SpawnError;
use crate::linux::thread::{Thread, spawn};
use crate::linux::timer::TimerFd;
use crate::pi_mutex::PiMutex;
use crate::{EnforcerConfig, EnforcerStats, Low, Params, Policy, ThreadSpec, Tid};
use sporadic::Budget;
use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pending replenishments of a budget: the pieces that it can come back in. A program that has
/// waited often and then works without a pause would be lowered at the end of each piece. One that
/// waits more often within a period gets pieces together, at the later time.
const REPLENISHMENTS: u16 = 16;

/// The share of a thread's ring of switch records in the memory of this user, see
/// `ContextSwitchLog`: three pages, two of them for records.
const RINGS: usize = 32;

/// Gives budgets to foreign threads, of other processes or of this one, and gives the threads back
/// what they had when it is dropped.
///
/// May be used from any thread. When its process is killed, the threads keep what they have: hold
/// [`Original`](super::Original)s in another process to give theirs back (`replenish run` does).
#[derive(Debug)]
pub struct Enforcer {
    state: Arc<State>,
    thread: PiMutex<Option<Thread<()>>>,
    /// Started with the first budget whose threads are to be stopped.
    freezer: PiMutex<Option<Freezer>>,
    cpu_clock: ThreadCpuClock,
    cpu: usize,
    unlocked: Option<LockError>,
}

impl Enforcer {
    /// Starts the enforcer's thread. `config.cpu` is the CPU of every thread that gets a budget,
    /// CPU 0 where it is `None`; `config.capacity` the number of threads that may share one budget.
    ///
    /// # Errors
    /// [`SpawnError`] when the CPU does not exist or the priority is not granted.
    pub fn start(mut config: EnforcerConfig) -> Result<Self, SpawnError> {
        let cpu = config.cpu.unwrap_or(0);
        config.capacity = config.capacity.clamp(1, 1024);
        let spec = ThreadSpec::new(format!("enforcer/{cpu}"))
            .policy(Policy::Fifo {
                priority: config.priority,
            }) // checked by `spawn`
            .stack_size(ENFORCER_STACK)
            .cpu(cpu);
        let state = Arc::new(State {
            groups: PiMutex::new(Groups {
                budgets: Vec::with_capacity(MOST_BUDGETS),
                events: Vec::with_capacity(MOST_EVENTS),
                alarm: Alarm::new(),
                stats: EnforcerStats::default(),
            }),
            timer: TimerFd::new().map_err(SpawnError::Create)?,
            stop: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            config,
        });
        let theirs = Arc::clone(&state);
        let thread = spawn(spec, move || theirs.run())?;
        let keep = state.config.keep_memory;
        Ok(Self {
            unlocked: keep.then(memory::keep_program).and_then(Result::err),
            state,
            cpu_clock: ThreadCpuClock::of(thread.tid()),
            thread: PiMutex::new(Some(thread)),
            freezer: PiMutex::new(None),
            cpu,
        })
    }

    /// The CPU of the enforcer and of its threads.
    #[must_use]
    pub fn cpu(&self) -> usize {
        self.cpu
    }

    /// As [`crate::Enforcer::memory_refused`].
    #[must_use]
    pub const fn memory_refused(&self) -> Option<&LockError> {
        self.unlocked.as_ref()
    }

    /// A new budget, without a thread: FIFO `priority` (1 to 98) while there is some left,
    /// otherwise `background`: [`SchedClass::Idle`], [`SchedClass::Other`], or FIFO below
    /// `priority`.
    ///
    /// # Errors
    /// [`ForeignError`] for a value out of its range, and for the 65th budget.
    pub fn budget(
        &self,
        priority: u8,
        budget: Budget,
        background: SchedClass,
    ) -> Result<BudgetId, ForeignError> {
        let config = &self.state.config;
        if priority == 0 || priority >= config.priority {
            return Err(ForeignError::Priority {
                value: priority,
                enforcer: config.priority,
            });
        }
        let low = match background {
            SchedClass::Other | SchedClass::Idle => 0,
            SchedClass::Fifo(low) if low > 0 && low < priority => low,
            SchedClass::Fifo(_) | SchedClass::RoundRobin(_) => {
                return Err(ForeignError::Background { priority });
            }
        };
        let (amount, period) = (budget.amount, budget.period);
        let params = Params::new(
            priority,
            Low::Background(low),
            amount,
            period,
            REPLENISHMENTS,
        )
        .map_err(ForeignError::Params)?;
        let classes = Classes {
            priority,
            background,
        };
        let now = clock::monotonic();
        let group = Group::new(params, classes, config.tuning, config.capacity, now);
        let mut groups = self.state.groups.lock();
        let (place, _old) = groups.add(group)?;
        drop(groups); // before the memory of an old one
        Ok(BudgetId(place))
    }

    /// From now on the threads of `budget` do not run at all without budget: `freeze` is the
    /// `cgroup.freeze` of a control group of version 2 that has them and nobody else. Whoever puts
    /// a thread into the control group takes it out before it is released.
    ///
    /// # Errors
    /// [`SpawnError`] when the thread that writes to the file cannot be started.
    pub fn suspend_by(&self, budget: BudgetId, freeze: File) -> Result<(), SpawnError> {
        let mut freezer = self.freezer.lock();
        if freezer.is_none() {
            let below = self.state.config.priority.saturating_sub(1).max(1);
            *freezer = Some(Freezer::start(self.cpu, below)?);
        }
        let brake = freezer.as_ref().map(|freezer| freezer.brake(freeze));
        let mut groups = self.state.groups.lock();
        if let Some((group, brake)) = groups.budgets.get_mut(budget.0).zip(brake) {
            group.suspend_by(brake);
        }
        Ok(())
    }

    /// Ends a budget: its threads get back what they had, and its place and its [`BudgetId`] are
    /// for the next one.
    pub fn retire(&self, budget: BudgetId) {
        let of_it = |thread: &ThreadUsage| thread.budget == budget;
        for thread in self.threads().into_iter().filter(of_it) {
            self.release(thread.tid);
        }
        if let Some(group) = self.state.groups.lock().budgets.get_mut(budget.0) {
            group.retired = true;
        }
    }

    /// Puts a thread under a budget: from now on it runs on the enforcer's CPU, at the level that
    /// the budget has. Allocates.
    ///
    /// # Errors
    /// [`ForeignError`] when the thread has ended, has a budget here already, or may not be changed
    /// by this user; when the budget's places are taken. The thread is then as it was.
    pub fn enroll(&self, budget: BudgetId, thread: ForeignThread) -> Result<(), ForeignError> {
        let tid = thread.tid();
        let original = *thread.original();
        let enrolled = self.try_enroll(budget, thread);
        let untouched = matches!(
            enrolled,
            Ok(()) | Err(ForeignError::Enrolled { .. } | ForeignError::Above { .. })
        );
        if !untouched {
            original.apply(tid).ok(); // as far as anything was changed
        }
        enrolled
    }

    fn try_enroll(&self, budget: BudgetId, thread: ForeignThread) -> Result<(), ForeignError> {
        let (tid, config) = (thread.tid(), &self.state.config);
        let refused = |what| move |source| ForeignError::Refused { tid, what, source };
        let priority = thread.original().priority();
        if thread.is_own() && priority >= config.priority.into() {
            return Err(ForeignError::Above { tid, priority });
        }
        if self.state.groups.lock().has(tid) {
            return Err(ForeignError::Enrolled { tid });
        }
        let log = config
            .switch_log
            .then(|| ContextSwitchLog::open_counting(tid, RINGS));
        let member = Member::new(thread, log.and_then(Result::ok));
        set_affinity(tid, &CpuSet::one(self.cpu)).map_err(refused("CPUs"))?;
        let mut groups = self.state.groups.lock();
        if self.state.ended.load(Ordering::SeqCst) {
            return Err(ForeignError::NoEnforcer);
        }
        let Groups {
            budgets, events, ..
        } = &mut *groups;
        let full = ForeignError::Full {
            what: "threads of one budget",
            capacity: config.capacity,
        };
        let group = budgets.get_mut(budget.0).ok_or(ForeignError::Full {
            what: "budgets",
            capacity: MOST_BUDGETS,
        })?;
        if group.members.len() == config.capacity {
            return Err(full);
        }
        group.welcome(clock::monotonic(), events);
        let (level, classes) = (group.level(), group.classes);
        group.members.push(member);
        let at = group.check_at();
        // Before it is raised: from then on it can keep the calling thread from its CPU.
        self.state.arm(&mut groups, at);
        let group = groups.budgets.get_mut(budget.0);
        let given = group.map_or(Ok(()), |group| group.give_last(level, classes));
        given.map_err(refused("policy"))
    }

    /// Takes a thread out of its budget and gives it back what it had; its last figures. `None` if
    /// it is not enrolled here.
    pub fn release(&self, tid: Tid) -> Option<ThreadUsage> {
        let mut groups = self.state.groups.lock();
        self.state
            .read_last(&mut groups, |member| member.thread.tid() == tid);
        let (member, budget) = groups.take(tid)?;
        drop(groups);
        member.thread.restore().ok(); // a privilege was given up: it stays as it is
        Some(member.figures(budget).into())
    }

    /// Gives every thread back what it had.
    pub fn release_all(&self) {
        loop {
            let any = self.state.groups.lock().any();
            let Some(tid) = any else { return };
            self.release(tid);
        }
    }

    /// Looks after the threads, to be called every few milliseconds to seconds by a thread that is
    /// not the enforcer: finds those that have ended, and gives those that changed their policy or
    /// their CPU what they were given. Allocates where one has ended.
    pub fn inspect(&self) -> Inspection {
        let mut found = Inspection::default();
        let zombies = self.zombies();
        for place in 0..MOST_BUDGETS {
            let budget = BudgetId(place);
            // The lock is held for one thread at a time: the enforcer waits for it.
            let mut next = 0;
            loop {
                let mut groups = self.state.groups.lock();
                let Some(group) = groups.budgets.get_mut(place) else {
                    return found;
                };
                let (level, classes) = (group.level(), group.classes);
                let Some(member) = group.members.get_mut(next) else {
                    let Some(member) = group.take_ended() else {
                        break;
                    };
                    drop(groups); // before memory is taken, and the member's files are closed
                    found.ended.push(member.figures(budget).into());
                    continue;
                };
                if member.is_gone(&zombies) {
                    let tid = member.thread.tid();
                    let is_it = |member: &Member| !member.ended && member.thread.tid() == tid;
                    self.state.read_last(&mut groups, is_it);
                    let group = groups.budgets.get_mut(place);
                    let member = group.and_then(|group| group.members.get_mut(next));
                    if let Some(member) = member {
                        member.ended = true;
                    }
                } else {
                    found.displaced += u64::from(member.is_displaced(level, classes, self.cpu));
                }
                next += 1;
            }
        }
        found
    }

    /// Processes that have ended and were not waited for.
    fn zombies(&self) -> Vec<Tid> {
        let mut firsts = self.threads();
        firsts.retain(|thread| thread.pid == thread.tid && is_zombie(thread.tid));
        firsts.iter().map(|thread| thread.tid).collect()
    }

    /// A budget up to this moment; `None` for one of another enforcer.
    #[must_use]
    pub fn usage(&self, budget: BudgetId) -> Option<BudgetUsage> {
        let mut groups = self.state.groups.lock();
        let Groups {
            budgets, events, ..
        } = &mut *groups;
        let group = budgets.get_mut(budget.0)?;
        group.observe(clock::monotonic(), events);
        let (usage, at) = (group.usage(), group.check_at());
        self.state.arm(&mut groups, at);
        Some(usage)
    }

    /// Every enrolled thread, as of the last reading. Allocates.
    #[must_use]
    pub fn threads(&self) -> Vec<ThreadUsage> {
        let mut found: Vec<Figures> = Vec::new();
        loop {
            let groups = self.state.groups.lock();
            let count = groups.budgets.iter().map(|group| group.members.len()).sum();
            if found.capacity() < count {
                drop(groups); // the enforcer waits for it, and must not wait for memory
                found.reserve(count);
                continue;
            }
            for (place, group) in groups.budgets.iter().enumerate() {
                let figures = |member: &Member| member.figures(BudgetId(place));
                found.extend(group.members.iter().map(figures));
            }
            drop(groups);
            return found.into_iter().map(ThreadUsage::from).collect();
        }
    }

    /// Counters of the enforcer's thread.
    #[must_use]
    pub fn stats(&self) -> EnforcerStats {
        EnforcerStats {
            cpu: self.cpu_clock.read().unwrap_or(0),
            ..self.state.groups.lock().stats
        }
    }

    fn stop(&self) {
        self.state.stop.store(true, Ordering::SeqCst);
        {
            let mut groups = self.state.groups.lock();
            self.state.arm(&mut groups, 1);
        }
        let thread = self.thread.lock().take();
        if let Some(thread) = thread
            && thread.join().is_err()
        {
            complain(format_args!("the enforcer thread panicked"));
        }
    }
}

impl Drop for Enforcer {
    fn drop(&mut self) {
        self.release_all();
        self.stop();
        drop(self.freezer.lock().take());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enforcer_that_cannot_read_its_timer_raises_nobody_any_more() {
        let state = Arc::new(State {
            groups: PiMutex::new(Groups {
                budgets: Vec::new(),
                events: Vec::with_capacity(MOST_EVENTS),
                alarm: Alarm::new(),
                stats: EnforcerStats::default(),
            }),
            timer: TimerFd::broken(),
            stop: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            config: EnforcerConfig::on_cpu(0),
        });
        let theirs = Arc::clone(&state);
        let thread = spawn(ThreadSpec::new("enforcer"), move || {
            let params = Params::new(60, Low::Background(0), 1000, 100_000, 16).unwrap();
            let (background, priority) = (SchedClass::Idle, 60);
            let classes = Classes {
                priority,
                background,
            };
            let (tuning, now) = (theirs.config.tuning, clock::monotonic());
            let group = Group::new(params, classes, tuning, 4, now);
            assert_eq!(group.level(), crate::Level::High);
            theirs.groups.lock().add(group).unwrap();
            theirs.run();
        });
        let thread = thread.unwrap();
        let enforcer = Enforcer {
            cpu_clock: ThreadCpuClock::of(thread.tid()),
            thread: PiMutex::new(Some(thread)),
            freezer: PiMutex::new(None),
            cpu: 0,
            unlocked: None,
            state,
        };
        let thread = enforcer.thread.lock().take().unwrap();
        assert!(thread.join().is_ok());
        let usage = enforcer.usage(BudgetId(0)).unwrap();
        assert_eq!(usage.level, crate::Level::Low);
        let (tell, told) = std::sync::mpsc::channel();
        let (end, ends) = std::sync::mpsc::channel::<()>();
        let other = std::thread::spawn(move || {
            tell.send(crate::current_tid()).unwrap();
            ends.recv().ok();
        });
        let other_thread = ForeignThread::open_own(told.recv().unwrap()).unwrap();
        let refused = enforcer.enroll(BudgetId(0), other_thread).unwrap_err();
        assert!(matches!(refused, ForeignError::NoEnforcer), "{refused}");
        drop(end);
        other.join().unwrap();
    }
}
