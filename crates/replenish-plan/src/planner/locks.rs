//! The critical sections that workers share, each with its length, and the waits that follow.
//!
//! A guaranteed worker waits for the holder of a lock that it shares, and the holder runs at its
//! priority meanwhile (priority inheritance). The analysis counts that as blocking. It needs each
//! length, and all workers that share the lock on one CPU; without either the request is refused
//! here.

use crate::guarantee::MAX_PERIOD;
use crate::request::Hold;
use crate::{Nanos, Request, Requirement, Worker};
use replenish_sim::analysis::Section;
use sporadic::Policy;

/// Stands for a length that was not stated: no deadline is as long.
pub(super) const UNKNOWN: Nanos = MAX_PERIOD;
/// The most locks of one request.
const MOST: usize = 4096;

/// The effect of shared locks on each worker.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Shared {
    /// The locks that it shares with other workers, each once, with the longest callback.
    pub(crate) sections: Vec<Section>,
    /// Guaranteed workers of the same number go to one CPU.
    pub(super) together: Option<usize>,
    /// The CPU that another of these is pinned to.
    pub(super) cpu: Option<usize>,
}

/// A worker that holds a lock.
#[derive(Clone, Copy)]
struct Member<'r> {
    index: usize,
    worker: &'r Worker,
    /// Its longest hold, or one of unknown length.
    hold: &'r Hold,
    length: Option<Nanos>,
}

impl Member<'_> {
    fn name(&self) -> String {
        let worker = &self.worker.name;
        match self.hold.handle.as_str() {
            "" => format!("worker {worker:?}"),
            handle => format!("{handle} of worker {worker:?}"),
        }
    }

    fn is_guaranteed(&self) -> bool {
        self.worker.guarantee().is_some()
    }
}

/// The shared locks, by worker.
///
/// # Errors
/// A lock that a guaranteed worker shares and that gives it no bound, in a sentence.
pub(crate) fn shared(request: &Request) -> Result<Vec<Shared>, String> {
    if request.locks.len() > MOST {
        return Err(format!(
            "{} locks: allowed up to {MOST}",
            request.locks.len()
        ));
    }
    let mut all = vec![Shared::default(); request.workers.len()];
    let mut merged: Vec<usize> = (0..request.workers.len()).collect();
    for (lock, name) in request.locks.iter().enumerate() {
        let members = members(request, lock);
        if members.len() < 2 {
            continue; // one worker's callbacks never run at the same time
        }
        check(request, name, &members)?;
        for member in &members {
            if let Some(shared) = all.get_mut(member.index) {
                let length = member.length.unwrap_or(UNKNOWN);
                shared.sections.push(Section { lock, length });
            }
        }
        if members.iter().any(Member::is_guaranteed) {
            join(&mut merged, &members);
        }
    }
    for index in 0..all.len() {
        let number = merged.get(index).copied();
        let those = || merged.iter().zip(&request.workers);
        let of_them = those().filter(|(m, _)| Some(**m) == number);
        let mut pins: Vec<(usize, &str)> = of_them
            .filter_map(|(_, w)| Some((w.cpu?, &*w.name)))
            .collect();
        pins.sort_unstable();
        if let (Some((low, one)), Some((high, other))) = (pins.first(), pins.last())
            && low != high
        {
            return Err(format!(
                "workers {one:?} and {other:?} wait for each other's groups from CPUs {low} and {high}, which has no bound; pin both to one CPU, or take one of them out of the groups"
            ));
        }
        if let Some(shared) = all.get_mut(index) {
            let alone = those().filter(|(m, _)| Some(**m) == number).count() < 2;
            shared.together = number.filter(|_| !alone);
            shared.cpu = pins.first().map(|(cpu, _)| *cpu).filter(|_| !alone);
        }
    }
    Ok(all)
}

/// The members of one lock are in one set from now on.
fn join(merged: &mut [usize], members: &[Member<'_>]) {
    let Some(to) = members.first().and_then(|m| merged.get(m.index).copied()) else {
        return;
    };
    for member in members {
        if let Some(from) = merged.get(member.index).copied() {
            merged
                .iter_mut()
                .filter(|m| **m == from)
                .for_each(|m| *m = to);
        }
    }
}

fn members(request: &Request, lock: usize) -> Vec<Member<'_>> {
    let mut members = Vec::new();
    for (index, worker) in request.workers.iter().enumerate() {
        let holds = worker.holds.iter().filter(|h| h.lock == lock);
        let length = |hold: &Hold| hold.length.or_else(|| by_guarantee(worker));
        let longest = holds.max_by_key(|h| length(h).unwrap_or(Nanos::MAX));
        members.extend(longest.map(|hold| Member {
            index,
            worker,
            hold,
            length: length(hold),
        }));
    }
    members
}

/// A rate says how long each callback takes.
fn by_guarantee(worker: &Worker) -> Option<Nanos> {
    let guarantee = worker.guarantee().filter(|g| g.is_rate())?;
    Some(guarantee.desired())
}

/// Checks that each worker with which a guaranteed one shares this lock has a bound.
fn check(request: &Request, lock: &str, members: &[Member<'_>]) -> Result<(), String> {
    for waiting in members.iter().filter(|m| m.is_guaranteed()) {
        let others = members.iter().filter(|m| m.index != waiting.index);
        for other in others {
            why_not(request, lock, waiting, other).map_or(Ok(()), Err)?;
        }
    }
    Ok(())
}

fn why_not(
    request: &Request,
    lock: &str,
    waiting: &Member<'_>,
    other: &Member<'_>,
) -> Option<String> {
    let both = format!(
        "{} would wait in group {lock:?} for {}",
        waiting.name(),
        other.name()
    );
    if other.length.is_none() {
        return Some(format!(
            "{both}, and nobody has stated for how long at most; state it (Group::holds; in a file: holds), or take one of them out of the group"
        ));
    }
    if let Requirement::Policy(Policy::Deadline { .. }) = other.worker.scheduling {
        return Some(format!(
            "{both}, which SCHED_DEADLINE may stop there; give that one another policy, or take one of them out of the group"
        ));
    }
    if !other.is_guaranteed() && other.worker.cpu.is_none() && request.machine.cpus.len() > 1 {
        return Some(format!(
            "{both} from another CPU, which has no bound; pin both to one CPU, or take one of them out of the group"
        ));
    }
    None
}
