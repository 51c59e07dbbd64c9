//! Assigns threads to CPUs by priority.

use super::phase::Phase;
use super::simulation::Sim;
use crate::{End, What};

impl Sim<'_> {
    /// Gives the CPUs to the most urgent threads. A thread without a fixed CPU stays where it is
    /// if it can, else takes an idle CPU, else the last one that is left.
    pub(super) fn reschedule(&mut self) {
        while self.assign() {
            self.switch_off();
            if !self.switch_on() {
                return;
            }
        }
    }

    /// Computes the assignment; false if it is in force already.
    fn assign(&mut self) -> bool {
        self.assigned.fill(None);
        let mut free = self.cpus.len();
        for id in self.ready.iter() {
            if free == 0 {
                break;
            }
            let cpu = match self.system.threads[id].cpu {
                Some(cpu) => cpu,
                None => self.pick_cpu(id),
            };
            if self.assigned[cpu].is_none() {
                self.assigned[cpu] = Some(id);
                free -= 1;
            }
        }
        let in_force = self.cpus.iter().zip(&self.assigned);
        in_force.into_iter().any(|(cpu, new)| cpu.running != *new)
    }

    fn pick_cpu(&self, id: usize) -> usize {
        let is_free = |cpu: &usize| self.assigned[*cpu].is_none();
        let mut all = 0..self.cpus.len();
        self.states[id]
            .on
            .filter(is_free)
            .or_else(|| {
                all.clone()
                    .filter(is_free)
                    .find(|&cpu| self.cpus[cpu].running.is_none())
            })
            .or_else(|| all.rfind(is_free))
            .unwrap_or(0)
    }

    fn switch_off(&mut self) {
        for cpu in 0..self.cpus.len() {
            let Some(id) = self.cpus[cpu].running else {
                continue;
            };
            if self.assigned[cpu] == Some(id) {
                continue;
            }
            self.cpus[cpu].running = None;
            self.states[id].on = None;
            if self.states[id].phase == Phase::Ready {
                self.states[id].out.preemptions += 1;
                self.note(id, What::Preempt { cpu });
            } else {
                self.note(id, What::Yield { cpu });
            }
        }
    }

    /// Starts the new ones; true if that changed who is ready with what priority.
    fn switch_on(&mut self) -> bool {
        let mut changed = false;
        for cpu in 0..self.cpus.len() {
            let Some(id) = self.assigned[cpu] else {
                continue;
            };
            if self.cpus[cpu].running == Some(id) {
                continue;
            }
            self.cpus[cpu].running = Some(id);
            let state = &mut self.states[id];
            state.on = Some(cpu);
            if self.cpus[cpu].last.replace(id) != Some(id) {
                state.left += self.system.platform.context_switch;
            }
            self.note(id, What::Run { cpu });
            if let Some(woken) = self.states[id].woken.take() {
                self.activate_budget(id, woken);
                changed = true;
            }
        }
        changed
    }

    /// Brings the ready list up to date with a thread's phase and priority, joining at `end` if it
    /// moves; then the same for the thread that inherits from it.
    pub(super) fn refresh(&mut self, id: usize, end: End) {
        let rank = self.inherited_rank(id);
        let state = &mut self.states[id];
        let before = core::mem::replace(&mut state.rank, rank);
        let runnable = state.phase == Phase::Ready && rank.is_some();
        if state.queued && (!runnable || before != rank) {
            state.queued = false;
            self.ready.remove(id);
        }
        if let Some(rank) = rank
            && runnable
            && !state.queued
        {
            state.queued = true;
            self.ready.insert(rank, id, end);
        }
        if let Phase::LockWait(lock) = state.phase
            && before != rank
            && let Some(owner) = self.locks[lock].owner
        {
            let end = if rank > before { End::Tail } else { End::Head };
            self.refresh(owner, end);
        }
    }
}
