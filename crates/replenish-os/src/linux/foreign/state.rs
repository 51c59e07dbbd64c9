//! The thread of the enforcer, and the state that it shares with those who ask it.

use super::group::{Group, NEVER};
use super::groups::Groups;
use super::member::Member;
use crate::linux::clock;
use crate::linux::console::complain;
use crate::linux::timer::TimerFd;
use crate::pi_mutex::PiMutex;
use crate::{EnforcerConfig, Nanos};
use std::sync::atomic::{AtomicBool, Ordering};

#[derive(Debug)]
pub(super) struct State {
    pub(super) groups: PiMutex<Groups>,
    pub(super) timer: TimerFd,
    pub(super) stop: AtomicBool,
    /// The thread has ended without being asked to.
    pub(super) ended: AtomicBool,
    pub(super) config: EnforcerConfig,
}

impl State {
    /// The enforcer's thread. Nothing in here allocates.
    pub(super) fn run(&self) {
        while !self.stop.load(Ordering::SeqCst) {
            if let Err(e) = self.timer.read() {
                // For good: signals are no error. It would come back at once, for ever.
                self.abandon();
                complain(format_args!(
                    "the enforcer of other threads cannot read its timer ({e}): they stay in the \
                     background"
                ));
                return;
            }
            let mut groups = self.groups.lock();
            groups.alarm.fired();
            groups.stats.wakes += 1;
            if !self.sweep(&mut groups) {
                groups.stats.idle_wakes += 1;
            }
            let at = groups.budgets.iter().map(Group::check_at).min();
            self.arm(&mut groups, at.unwrap_or(NEVER));
        }
    }

    /// All threads are in the background: without an enforcer none may have a high priority.
    fn abandon(&self) {
        let mut groups = self.groups.lock();
        self.ended.store(true, Ordering::SeqCst);
        let now = clock::monotonic();
        for group in &mut groups.budgets {
            group.abandon(now);
        }
    }

    /// A thread that is about to leave is charged for what it has used since the last reading.
    pub(super) fn read_last(&self, groups: &mut Groups, is_it: impl Fn(&Member) -> bool) {
        let Groups {
            budgets, events, ..
        } = &mut *groups;
        let group = budgets
            .iter_mut()
            .find(|group| group.members.iter().any(&is_it));
        if let Some(group) = group {
            group.observe(clock::monotonic(), events);
            let at = group.check_at();
            self.arm(groups, at);
        }
    }

    /// Judges every budget whose check is due; returns whether any level changed.
    fn sweep(&self, groups: &mut Groups) -> bool {
        let (now, slack) = (clock::monotonic(), self.config.tuning.slack);
        let mut changed = 0;
        for group in &mut groups.budgets {
            group.catch_up(now);
            let at = group.check_at();
            if at != NEVER && at <= now.saturating_add(slack) {
                changed += u64::from(group.judge(now, &mut groups.events));
            }
        }
        groups.stats.changes += changed;
        // No thread ran meanwhile.
        let took = clock::monotonic().saturating_sub(now);
        for group in &mut groups.budgets {
            if changed > 0 {
                group.pull_in(now);
            }
            group.postpone(took);
        }
        changed > 0
    }

    /// Makes sure that the timer fires at `at` or earlier, but not at once.
    pub(super) fn arm(&self, groups: &mut Groups, at: Nanos) {
        if at == NEVER {
            return;
        }
        let floor = match at {
            1 => 1, // to stop
            _ => clock::monotonic().saturating_add(self.config.tuning.min_rearm),
        };
        // Refused, it is tried again with the next check.
        groups
            .alarm
            .set(at.max(floor), |at| self.timer.arm(at))
            .ok();
    }
}
