//! Which client is served next, and when which client needs attention by itself.
//!
//! A client stands in line at the level of the most urgent thing that it can be sent; within a
//! level clients take turns, one datagram each. Its place in the agenda may be too early, never too
//! late: what only moves its deadline away does not move it there.

use super::state::AgentCore;
use crate::report::Reason;
use replenish_xrce::Nanos;
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// When [`pump`](Self::pump) must be called at the latest although nothing was received.
    #[must_use]
    pub fn next_deadline(&self) -> Option<Nanos> {
        let client = self.agenda.first().map(|(at, _)| *at);
        let pressed = self.pressed.iter().map(|pressed| pressed.until).min();
        let comeback = self.comeback.deadline().filter(|_| self.stashed);
        client.into_iter().chain(pressed).chain(comeback).min()
    }

    pub(super) fn next_in_line(&mut self) -> Option<usize> {
        let index = self.line.next()?;
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
                self.line.leave(queued, index);
            }
            self.line.join(level, index);
        }
        self.make_appointment(now, index);
    }

    /// Notes when a client needs attention by itself.
    pub(super) fn make_appointment(&mut self, now: Nanos, index: usize) {
        let Some(client) = self.clients.get_mut(index) else {
            return;
        };
        let deadline = client.deadline(&self.limits);
        if client
            .appointment
            .is_none_or(|at| at <= now || deadline < at)
        {
            if let Some(at) = client.appointment.replace(deadline) {
                self.agenda.remove(&(at, index));
            }
            self.agenda.insert((deadline, index));
        }
    }

    /// Forgets clients that were silent for too long; serves those whose time has come.
    pub(super) fn attend(&mut self, now: Nanos) {
        while let Some((_, index)) = self
            .agenda
            .first()
            .copied()
            .filter(|(deadline, _)| *deadline <= now)
        {
            self.agenda.pop_first();
            let Some(client) = self.clients.get_mut(index) else {
                continue;
            };
            client.appointment = None;
            if client.dies_at(&self.limits) <= now {
                self.counters.clients_reaped.hit();
                let limit = self.limits.silence;
                self.note_of(index, Reason::Silent { limit });
                self.remove(index);
                continue;
            }
            client.wake(now, &self.counters);
            // What is due now goes out with this pump, which looks at the agenda again after it.
            let due = client.urgency(now).is_some();
            if due && client.queued.is_none() {
                client.queued = client.urgency(now);
                self.line.join(client.queued.unwrap_or(0), index);
            } else if !due {
                self.serve(now, index);
            }
        }
        self.relieve(now);
    }
}
