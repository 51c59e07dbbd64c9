//! The order in which clients are served, and their timers.
//!
//! A client is queued at the level of its most urgent datagram; within a level clients take turns,
//! one datagram each. A timer may be too early, never too late: a deadline that moves away does not
//! move it.

use super::state::AgentCore;
use crate::report::Reason;
use replenish_xrce::Nanos;
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// The latest time at which [`pump`](Self::pump) must be called although nothing was received.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Nanos> {
        let client = self.timers.first().map(|(at, _)| *at);
        let blocked = self.unblocks_at();
        let recovery_window = self.recovery_window.deadline().filter(|_| self.stashed);
        client
            .into_iter()
            .chain(blocked)
            .chain(recovery_window)
            .min()
    }

    pub(super) fn next_client(&mut self) -> Option<usize> {
        let index = self.client_queue.next()?;
        if let Some(client) = self.clients.get_mut(index) {
            client.queued = None;
        }
        Some(index)
    }

    /// Lets a client stand in line where it belongs, and notes when it needs attention by itself.
    /// To be called after everything that gives it something to send.
    pub(super) fn serve(&mut self, now: Nanos, index: usize) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        if let Some(level) = client.urgency(now)
            && client.queued.is_none_or(|queued| queued < level)
        {
            if let Some(queued) = client.queued.replace(level) {
                self.client_queue.leave(queued, index);
            }
            self.client_queue.join(level, index);
        }
        self.set_timer(now, index);
    }

    /// Sets the timer of a client.
    pub(super) fn set_timer(&mut self, now: Nanos, index: usize) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let deadline = client.deadline(&self.limits);
        if client.timer.is_none_or(|at| at <= now || deadline < at) {
            if let Some(at) = client.timer.replace(deadline) {
                self.timers.remove(&(at, index));
            }
            self.timers.insert((deadline, index));
        }
    }

    /// Removes clients that were silent for too long; serves clients whose timer is due.
    pub(super) fn attend(&mut self, now: Nanos) {
        while let Some((_, index)) = self
            .timers
            .first()
            .copied()
            .filter(|(deadline, _)| *deadline <= now)
        {
            self.timers.pop_first();
            let Some(client) = self.clients.get_mut(index) else {
                continue;
            };
            client.timer = None;
            if client.dies_at(&self.limits) <= now {
                self.counters.clients_reaped.hit();
                let limit = self.limits.silence;
                self.note_of(index, Reason::Silent { limit });
                self.remove(index);
                continue;
            }
            client.wake(now, &self.counters);
            // Datagrams that are due now go out with this pump, which looks at the timers again
            // after it.
            let due = client.urgency(now).is_some();
            if due && client.queued.is_none() {
                client.queued = client.urgency(now);
                self.client_queue.join(client.queued.unwrap_or(0), index);
            } else if !due {
                self.serve(now, index);
            }
        }
        self.unblock(now);
    }
}
