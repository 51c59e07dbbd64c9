//! One look of the watchdog at an enforcer: does it still look after its workers, and do all of
//! them run with the policy that they were given?
//!
//! ```text
//!   enforcer's thread left ──────────► every worker is lowered for good        Fault::Ended
//!   a check is overdue ──────────────► the watchdog judges in its place        Fault::Silent
//!   its lock's owner is blocked ─────► every worker is lowered until it is not Fault::Silent
//!   its policy or CPU is another ────► restored, if the kernel allows          Fault::Displaced
//!   a worker's policy is another ────► restored; the enforcer judges           Fault::ForeignPolicy
//!   the kernel refuses a raise ──────► tried again after 1 to 100 ms          Fault::Refused
//! ```
//!
//! The watchdog shares the enforcer's lock and its state machine, so that nothing is to be put
//! straight when the enforcer comes back. It takes the lock where something seems wrong, and looks
//! again then:
//!
//! ```text
//!   without the lock                                              with it, if need be
//!   read the views ──► ask for policies and CPUs ──► once more ──► restore, judge, count
//! ```
//!
//! A watchdog that is kept from its CPU in the middle of a look thus keeps no enforcer waiting. For
//! the same reason it does not wait for the lock in the kernel, but tries again: an unlock hands
//! the lock over to a thread that waits, long before that thread has its CPU. From a less urgent
//! one it takes the lock then, as the enforcer does.
//!
//! An enforcer that the kernel stops in the middle of a judgement keeps its lock: it waits for a
//! page that is being moved, for instance. The watchdog then lowers the workers in the kernel
//! alone. The state machines do not hear of it: the first look that gets the lock gives back the
//! priorities that they have.
//!
//! Where the lock's owner waits for nothing but the enforcer's CPU, it has that thread's priority
//! and still does not get it: the kernel serves time-sharing threads (its fair server, its
//! throttle). No worker of that CPU runs at a high priority then, and none is lowered: that would
//! take from the workers the time that the kernel leaves them.

use super::change_user;
use super::config::{Enforcement, Fault, NEVER};
use super::enforced_thread::EnforcedThread;
use super::state::{EnforcedThreads, EnforcerState};
use super::views::Views;
use crate::backend::affinity::{CpuSet, affinity, set_affinity};
use crate::backend::clock;
use crate::backend::lock_wait::{PATIENCE, RETRY, lock_when_free};
use crate::backend::privilege::keep_priorities;
use crate::backend::sched::{self, SchedClass};
use crate::backend::spawn_error::SpawnError;
use crate::backend::tid::{is_of_this_process, wants_cpu};
use crate::backend::watchdog::{self, Watch};
use crate::pi_mutex::PiMutex;
use crate::{Arc, Level, Nanos, Tid};
use core::sync::atomic::{AtomicBool, Ordering};
use sporadic::{BudgetServer, Verdict};
use std::sync::{Mutex, OnceLock};

/// A check that is later than this is overdue, in nanoseconds. No enforcer that has its CPU is so
/// late; a machine that stands still may be, and then the look does no harm.
const OVERDUE: Nanos = 5_000_000;

type Hook = Arc<dyn Fn(&Fault) + Send + Sync>;

/// The watchdog's hold on one enforcer; ends when it is dropped.
#[derive(Debug)]
pub(super) struct Supervision {
    watch: Mutex<Option<Watch>>,
    /// The reason why there is no watchdog.
    refused: Option<SpawnError>,
    watched: Arc<Watched>,
}

/// An enforcer under supervision.
pub(super) struct Watched {
    state: Arc<EnforcerState>,
    /// The enforcer's thread, once it is known.
    enforcer: OnceLock<Tid>,
    /// The thread has left its loop without a stop.
    ended: AtomicBool,
    hook: PiMutex<Option<Hook>>,
    known: PiMutex<Known>,
}

/// The watchdog's own notes on an enforcer. A fault is reported again when its count has doubled.
struct Known {
    ended: bool,
    silent: u64,
    displaced: u64,
    /// The workers of the look under way, with room for all.
    workers: Vec<Worker>,
    /// The workers were lowered without the enforcer's lock, and nothing was given back yet.
    lowered: bool,
}

/// A worker as the enforcer believes it to be.
struct Worker {
    /// Its place among the enrolled threads.
    index: usize,
    tid: Tid,
    given: Option<u8>,
    resets: bool,
}

impl core::fmt::Debug for Watched {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Watched").finish_non_exhaustive()
    }
}

impl Supervision {
    /// Supervises the enforcer whose thread is `enforcer`. Raises stay possible if the program
    /// gives up its privileges, as far as its hard limit allows.
    pub(super) fn of(watched: Arc<Watched>, enforcer: Tid) -> Self {
        keep_priorities();
        change_user::note(&watched.state);
        watched.enforcer.set(enforcer).ok(); // nobody else sets it
        let look = Arc::clone(&watched);
        let (watch, refused) = match watchdog::watch(Arc::new(move || look.look())) {
            Ok(watch) => (Some(watch), None),
            Err(e) => (None, Some(e)),
        };
        Self {
            watch: Mutex::new(watch),
            refused,
            watched,
        }
    }

    /// The reason why there is no watchdog.
    pub(super) const fn refused(&self) -> Option<&SpawnError> {
        self.refused.as_ref()
    }

    pub(super) fn on_fault(&self, hook: impl Fn(&Fault) + Send + Sync + 'static) {
        *self.watched.hook.lock() = Some(Arc::new(hook));
    }

    /// Ends the looks: none runs after this.
    pub(super) fn end(&self) {
        if let Ok(mut watch) = self.watch.lock() {
            drop(watch.take());
        }
    }
}

impl Watched {
    pub(super) fn of(state: &Arc<EnforcerState>) -> Arc<Self> {
        let most = state.threads.lock().enrolled.capacity();
        Arc::new(Self {
            state: Arc::clone(state),
            enforcer: OnceLock::new(),
            ended: AtomicBool::new(false),
            hook: PiMutex::new(None),
            known: PiMutex::new(Known {
                ended: false,
                silent: 0,
                displaced: 0,
                workers: Vec::with_capacity(most),
                lowered: false,
            }),
        })
    }

    /// The enforcer's thread. However it leaves its loop but by a stop, it lowers its workers.
    pub(super) fn run(&self) {
        let _leaving = Leaving(self);
        self.state.run();
    }

    /// Looks once. Returns after how long to look again: the shortest period, within limits.
    fn look(&self) -> Nanos {
        let mut faults = Vec::new();
        let mut known = self.known.lock();
        let pause = if self.state.stop.load(Ordering::SeqCst) {
            watchdog::LONGEST
        } else if self.ended.load(Ordering::SeqCst) {
            self.lower_for_good(&mut known, &mut faults);
            watchdog::LONGEST
        } else {
            self.compare(&mut known, &mut faults)
        };
        drop(known);
        self.report(faults);
        pause.clamp(watchdog::SHORTEST, watchdog::LONGEST)
    }

    /// The enforcer's thread has left: it does not wait for its lock any more.
    fn lower_for_good(&self, known: &mut Known, faults: &mut Vec<Fault>) {
        faults.reserve(1); // not under the lock
        let mut threads = self.state.threads.lock();
        self.state.lower_all(&mut threads);
        if !core::mem::replace(&mut known.ended, true) {
            faults.push(Fault::Ended);
            threads.stats.faults += 1;
        }
    }

    /// Compares what the enforcer believes with the kernel's answers, and has put right what
    /// differs. Returns after how long to look again.
    fn compare(&self, known: &mut Known, faults: &mut Vec<Fault>) -> Nanos {
        let period = self.glance(known, faults);
        self.restore_enforcer(known, faults);
        known.workers.retain(Worker::seems_changed);
        self.glance_again(known);
        let wrong = !known.workers.is_empty();
        let late = clock::monotonic().saturating_sub(self.state.views.due());
        if late > OVERDUE || wrong || !faults.is_empty() {
            faults.reserve(known.workers.len() + 4); // not under the enforcer's lock
            if !self.correct(late, known, faults) {
                return watchdog::SHORTEST;
            }
        } else {
            known.lowered = false; // the enforcer has raised them itself
        }
        if wrong { watchdog::SHORTEST } else { period }
    }

    /// Notes what a look compares with the kernel's answers; the shortest period.
    fn glance(&self, known: &mut Known, faults: &mut Vec<Fault>) -> Nanos {
        known.workers.clear();
        let mut period = NEVER;
        for (index, view) in self.state.views.workers() {
            period = period.min(view.period);
            let thread = view.tid;
            faults.extend(view.is_news().then_some(Fault::Refused { thread }));
            known.workers.push(Worker {
                index,
                tid: view.tid,
                given: view.given(),
                resets: view.resets,
            });
        }
        period
    }

    /// Forgets the workers that have the priority they were given last by now: the first look was
    /// amid a change. Whoever takes the lock for it may lose its CPU with it.
    fn glance_again(&self, known: &mut Known) {
        if known.workers.is_empty() {
            return;
        }
        clock::sleep_until(clock::monotonic().saturating_add(RETRY));
        known.workers.retain_mut(|worker| {
            let view = self.state.views.worker(worker.index);
            view.is_some_and(|view| {
                worker.given = view.given();
                worker.seems_changed()
            })
        });
    }

    /// Whether workers may run at a high priority while the enforcer's lock cannot be had: its
    /// owner is blocked, or waits for another CPU than theirs.
    fn workers_run_on(&self) -> bool {
        let state = &self.state;
        let cpu = match state.mode {
            Enforcement::Deferred => return false, // they have no priority that could be lowered
            Enforcement::SameCpu => state.config.cpu,
            Enforcement::OtherCpu => None,
        };
        // An owner that gives the lock back at this moment, and waits for its timer, was not
        // blocked. It may have taken the lock again by the second look at the word, not each time.
        (0..3).all(|_| {
            let owner = state.threads.owner();
            let wants_cpu = |owner| cpu.is_some_and(|cpu| wants_cpu(owner, cpu));
            owner.is_some_and(|owner| !wants_cpu(owner)) && state.threads.owner() == owner
        })
    }

    /// Puts right, under the lock, what is still wrong now, and counts the faults. Where the lock
    /// cannot be had (`false`), the workers may have to be lowered without it.
    fn correct(&self, late: Nanos, known: &mut Known, faults: &mut Vec<Fault>) -> bool {
        let now = clock::monotonic();
        let state = &self.state;
        let Some(mut threads) = lock_when_free(&state.threads, now.saturating_add(PATIENCE)) else {
            // One that judges in time has its lock now and then, whoever has it at this moment.
            if clock::monotonic().saturating_sub(state.views.due()) > OVERDUE {
                known.silent(late.max(PATIENCE), faults);
                if self.workers_run_on() {
                    known.lowered |= state.views.lower();
                }
            }
            return false;
        };
        if state.stop.load(Ordering::SeqCst) {
            return true;
        }
        let ours = core::mem::take(&mut known.lowered);
        for worker in known.workers.drain(..) {
            let thread = threads.enrolled.get_mut(worker.index);
            let Some(thread) = thread.filter(|thread| thread.live) else {
                continue;
            };
            if ours {
                thread.restore(); // the watchdog itself has lowered it
            } else {
                faults.extend(thread.foreign());
            }
        }
        let due = threads.enrolled.iter().map(EnforcedThread::check_at);
        let due = due.min().unwrap_or(NEVER);
        let late = now.saturating_sub(due);
        if !self.ended.load(Ordering::SeqCst) {
            if late > OVERDUE {
                state.sweep(&mut threads, Enforcement::OtherCpu); // the workers run meanwhile
                known.silent(late, faults);
            } else if due != NEVER {
                state.arm(&mut threads, due); // a worker that lost its priority is due now
            }
        }
        threads.stats.faults += faults.len() as u64;
        true
    }

    /// The enforcer has its priority and its CPU.
    fn restore_enforcer(&self, known: &mut Known, faults: &mut Vec<Fault>) {
        let config = &self.state.config;
        let Some(&enforcer) = self.enforcer.get() else {
            return;
        };
        let Ok(priority) = sched::base_priority(enforcer) else {
            return;
        };
        let lowered = priority != Some(config.priority);
        if lowered {
            let fifo = SchedClass::Fifo(config.priority);
            sched::set_priority(enforcer, fifo).ok();
        }
        let moved = config.cpu.is_some_and(|cpu| {
            let home = CpuSet::one(cpu);
            let moved = affinity(enforcer).is_ok_and(|cpus| cpus != home);
            if moved {
                set_affinity(enforcer, &home).ok(); // refused while the CPU is offline
            }
            moved
        });
        if lowered || moved {
            known.displaced += 1;
            if known.displaced.is_power_of_two() {
                faults.push(Fault::Displaced);
            }
        }
    }

    /// Calls the hook on another thread: it is the user's code, at no real-time priority.
    fn report(&self, faults: Vec<Fault>) {
        if faults.is_empty() {
            return;
        }
        let Some(hook) = self.hook.lock().clone() else {
            return;
        };
        watchdog::call(move || faults.iter().for_each(|fault| hook(fault)));
    }
}

/// The result of giving a thread its own priority again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Restored {
    /// It has it, or it is unknown which one it was given.
    Unchanged,
    Changed,
    /// The kernel refuses it.
    Refused,
}

impl EnforcedThread {
    /// Gives the thread the priority again that it was given last, if it has another one. If the
    /// kernel refuses, a thread that was to be high is low from now on by its account, too: a check
    /// is due at once, at which the refusal is seen, and reported.
    pub(super) fn restore(&mut self) -> Restored {
        let view = &self.supervised.view;
        let (Some(given), Ok((has, resets))) = (view.given(), sched::base_policy(self.tid)) else {
            return Restored::Unchanged;
        };
        if has == Some(given) && (resets || !view.resets) {
            return Restored::Unchanged;
        }
        if sched::set_policy(self.tid, SchedClass::of(given), view.resets).is_ok() {
            return Restored::Changed;
        }
        let high = self.reservation.server().params().priority();
        if given == high && !sched::has_level(self.tid, high, Level::High) {
            self.lost_priority(clock::monotonic());
        }
        Restored::Refused
    }

    /// The thread lost its high priority to somebody else, and the kernel does not give it back.
    fn lost_priority(&mut self, now: Nanos) {
        if self.reservation.level() == Level::High {
            let cpu = self.cpu(now);
            // Nothing was used up: there is no overrun to record.
            self.reservation.applied(Level::Low, now, cpu);
            self.supervised.note(None, false);
        }
    }

    /// Restores its policy; the fault, if it is to be reported. CPU time at a priority above its
    /// own, without budget, is a debt.
    fn foreign(&mut self) -> Option<Fault> {
        let thread = self.tid;
        let above = self.supervised.is_above_its_own();
        if self.restore() != Restored::Changed {
            return None;
        }
        if above {
            self.escaped = true;
            self.observe(clock::monotonic());
        }
        self.supervised.foreign += 1;
        let tell = self.supervised.foreign.is_power_of_two();
        tell.then_some(Fault::ForeignPolicy { thread })
    }
}

impl Known {
    fn silent(&mut self, late: Nanos, faults: &mut Vec<Fault>) {
        self.silent += 1;
        if self.silent.is_power_of_two() {
            faults.push(Fault::Silent { late });
        }
    }
}

impl Views {
    /// Lowers every worker in the kernel, as far as it is a thread of this process still; whether
    /// there is any.
    fn lower(&self) -> bool {
        let mut any = false;
        for (_, view) in self.workers() {
            if is_of_this_process(view.tid) {
                // Refused: it has just ended, or the program gave up its privileges.
                sched::set_priority(view.tid, SchedClass::of(view.low)).ok();
                any = true;
            }
        }
        any
    }
}

impl Worker {
    /// Whether it has a priority other than its own. The enforcer may have given it that since the
    /// copy: then it is right.
    fn seems_changed(&self) -> bool {
        let differs = |(has, resets): (_, bool)| has != self.given || (self.resets && !resets);
        self.given.is_some() && sched::base_policy(self.tid).is_ok_and(differs)
    }
}

impl EnforcerState {
    /// Lowers all threads, in place of an enforcer that is silent or has ended.
    pub(super) fn lower_all(&self, threads: &mut EnforcedThreads) {
        let now = clock::monotonic();
        let mode = match self.mode {
            Enforcement::SameCpu => Enforcement::OtherCpu, // the workers run meanwhile
            mode => mode,
        };
        for thread in threads.enrolled.iter_mut().filter(|thread| thread.live) {
            if thread.reservation.level() == Level::High {
                let change = Some(Level::Low);
                thread.obey(Verdict { change }, now, 0, mode);
            }
        }
    }
}

struct Leaving<'a>(&'a Watched);

impl Drop for Leaving<'_> {
    fn drop(&mut self) {
        let state = &self.0.state;
        if !state.stop.load(Ordering::SeqCst) {
            self.0.ended.store(true, Ordering::SeqCst);
            state.lower_all(&mut state.threads.lock());
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests;
