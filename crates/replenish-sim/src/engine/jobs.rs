//! Releases, and the steps of a job.

use super::phase::Phase;
use super::simulation::{Sim, Timer};
use crate::{End, Nanos, Overflow, Releases, Step, What};

impl Sim<'_> {
    /// Sets the timer of the release after the one that arrived at `last`.
    pub(super) fn schedule_release(&mut self, id: usize, last: Option<Nanos>) {
        let state = &mut self.states[id];
        let index = state.release_index;
        state.release_index += 1;
        let mut delay = 0;
        let arrival = match state.releases {
            Releases::Never => None,
            Releases::Periodic {
                offset,
                period,
                jitter,
            } => {
                delay = state.random.up_to(*jitter);
                last.map_or(Some(*offset), |last| last.checked_add(*period))
            }
            Releases::Sporadic { offset, gap } => match last {
                None => Some(*offset),
                Some(last) => last.checked_add(gap.draw(&mut state.random).max(1)),
            },
            Releases::Bursty {
                offset,
                period,
                burst,
                spacing,
            } => {
                let burst = u64::from(*burst);
                let (round, place) = (index as u64 / burst, index as u64 % burst);
                round
                    .checked_mul(*period)
                    .and_then(|start| start.checked_add(place * spacing))
                    .and_then(|start| start.checked_add(*offset))
            }
            Releases::At(times) => times.get(index).copied(),
        };
        if let Some(arrival) = arrival
            && arrival < self.horizon
        {
            let time = arrival.saturating_add(delay).max(self.now);
            self.set_timer(time, id, Timer::Release { arrival });
        }
    }

    /// A timer released the thread.
    pub(super) fn timed_release(&mut self, id: usize, arrival: Nanos) {
        self.stall(id, self.system.platform.release_interrupt);
        self.release(id, arrival);
        self.schedule_release(id, Some(arrival));
    }

    fn release(&mut self, id: usize, arrival: Nanos) {
        self.note(id, What::Release);
        let thread = &self.system.threads[id];
        let state = &mut self.states[id];
        state.out.released += 1;
        if state.phase == Phase::Idle {
            self.begin(id, arrival);
            self.wake(id);
            return;
        }
        let lost = if state.jobs.len() < thread.queue {
            state.jobs.push_back(arrival);
            return;
        } else if thread.overflow == Overflow::DropOldest && state.jobs.pop_front().is_some() {
            state.jobs.push_back(arrival);
            true
        } else {
            true
        };
        if lost {
            state.out.dropped += 1;
            self.note(id, What::Drop);
        }
    }

    /// Makes the job that arrived then the current one.
    fn begin(&mut self, id: usize, arrival: Nanos) {
        let state = &mut self.states[id];
        state.arrival = arrival;
        state.step = 0;
        state.started = false;
        state.left = self.system.platform.job;
    }

    /// The thread leaves a wait.
    pub(super) fn wake(&mut self, id: usize) {
        self.note(id, What::Wake);
        let between_jobs = self.states[id].phase == Phase::Idle;
        self.states[id].phase = Phase::Ready;
        if between_jobs || self.system.platform.blocking_seen {
            self.wake_budget(id);
        }
        self.wake_deadline(id);
        self.refresh(id, End::Tail);
    }

    /// The running thread has consumed what its last step asked for and does the next.
    pub(super) fn progress(&mut self, id: usize) {
        if !self.states[id].started {
            self.states[id].started = true;
            self.note(id, What::Start);
        }
        let step = self.states[id].step;
        self.states[id].step += 1;
        match self.system.threads[id].body.get(step) {
            Some(Step::Run(span)) => {
                let state = &mut self.states[id];
                state.left = span.draw(&mut state.random);
            }
            Some(Step::Block(span)) => {
                let state = &mut self.states[id];
                let end = self.now.saturating_add(span.draw(&mut state.random));
                if end > self.now {
                    state.phase = Phase::Blocked;
                    self.note(id, What::Block);
                    self.block_budget(id);
                    self.refresh(id, End::Tail);
                    self.set_timer(end, id, Timer::BlockEnd);
                }
            }
            Some(Step::Lock(lock)) => self.lock(id, *lock),
            Some(Step::Unlock(lock)) => self.unlock(id, *lock),
            Some(Step::Send(to)) => self.release(*to, self.now),
            None => self.complete(id),
        }
    }

    fn complete(&mut self, id: usize) {
        let state = &mut self.states[id];
        let response = self.now - state.arrival;
        state.out.completed += 1;
        state.out.responses.push(response);
        if self.system.threads[id]
            .deadline
            .is_some_and(|d| response > d)
        {
            state.out.misses += 1;
        }
        if let Some(arrival) = state.jobs.pop_front() {
            self.note(id, What::Complete { response });
            self.begin(id, arrival);
            return;
        }
        state.phase = Phase::Idle;
        self.note(id, What::Complete { response });
        self.end_budget(id);
        self.refresh(id, End::Tail);
    }
}
