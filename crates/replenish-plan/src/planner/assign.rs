//! Assigns workers to CPUs.
//!
//! Two tries, both deterministic:
//! 1. by shares: the largest first, each to the CPU with the least reserved (worst fit). Every CPU
//!    keeps room, which keeps responses short; one test per CPU at the end.
//! 2. by tests, if that does not hold and the set is not too large: the largest first, each to the
//!    first CPU that still holds with it (first fit).

use super::cpu::{self, CpuPlan, Failure, Victim};
use super::placement::{FixedThread, ThreadPlan};
use super::problem::{Problem, Whose};
use crate::Nanos;

/// The most threads for which the second try is made.
const FEW: usize = 100;

/// An assignment of all threads to CPUs, and the result of its test.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    /// Per CPU of the machine: threads by their index.
    pub(super) on: Vec<Vec<usize>>,
    /// Per CPU: its fixed threads by their index.
    pub(super) fixed: Vec<Vec<usize>>,
    pub(super) plans: Vec<CpuPlan>,
}

impl Placed {
    /// The first CPU that does not hold, with why.
    pub(super) fn failure(&self) -> Option<(usize, Failure)> {
        let plans = self.plans.iter().enumerate();
        plans
            .filter_map(|(at, plan)| Some((at, plan.failure?)))
            .next()
    }
}

/// Places the threads of `include` with these amounts.
pub(super) fn place(problem: &Problem<'_>, include: &[usize], amounts: &[Nanos]) -> Placed {
    let by_shares = tested(problem, worst_fit(problem, include, amounts), amounts);
    if by_shares.failure().is_none() || !second_try(problem, include) {
        return by_shares;
    }
    match first_fit(problem, include, amounts) {
        Some(by_tests) => tested(problem, by_tests, amounts),
        None => by_shares,
    }
}

/// Whether [`place`] finds no failure, which is quicker to tell.
pub(super) fn fits(problem: &Problem<'_>, include: &[usize], amounts: &[Nanos]) -> bool {
    let by_shares = worst_fit(problem, include, amounts);
    let mut cpus = by_shares.on.iter().zip(&by_shares.fixed);
    cpus.all(|(threads, fixed)| holds(problem, threads, fixed, amounts))
        || (second_try(problem, include) && first_fit(problem, include, amounts).is_some())
}

fn second_try(problem: &Problem<'_>, include: &[usize]) -> bool {
    let unplaced = |index: &usize| seat(problem, *index).is_some_and(|s| s.cpu.is_none());
    let movable = problem.request.machine.cpus.len() > 1 && include.iter().any(unplaced);
    movable && include.len() <= FEW
}

fn seat<'p>(problem: &'p Problem<'_>, index: usize) -> Option<&'p ThreadPlan> {
    problem.threads.get(index).map(|(_, seat)| seat)
}

type OnCpu<'p> = (Vec<(&'p ThreadPlan, Nanos)>, Vec<&'p FixedThread>);

fn on_cpu<'p>(
    problem: &'p Problem<'_>,
    threads: &[usize],
    fixed: &[usize],
    amounts: &[Nanos],
) -> OnCpu<'p> {
    let threads = threads.iter();
    let threads = threads.filter_map(|i| Some((seat(problem, *i)?, *amounts.get(*i)?)));
    let fixed = fixed.iter();
    let fixed = fixed.filter_map(|i| problem.fixed.get(*i).map(|(_, _, f)| f));
    (threads.collect(), fixed.collect())
}

/// Tests one CPU with these threads.
pub(super) fn test(
    problem: &Problem<'_>,
    threads: &[usize],
    fixed: &[usize],
    amounts: &[Nanos],
) -> CpuPlan {
    let (threads, fixed) = on_cpu(problem, threads, fixed, amounts);
    cpu::test(&threads, &fixed, &problem.request.machine)
}

/// Whether [`test()`] finds no failure, which is quicker to compute.
pub(super) fn holds(
    problem: &Problem<'_>,
    threads: &[usize],
    fixed: &[usize],
    amounts: &[Nanos],
) -> bool {
    let (threads, fixed) = on_cpu(problem, threads, fixed, amounts);
    cpu::holds(&threads, &fixed, &problem.request.machine)
}

/// Adds the plan of every CPU.
fn tested(problem: &Problem<'_>, mut placed: Placed, amounts: &[Nanos]) -> Placed {
    let cpus = placed.on.iter().zip(&placed.fixed);
    let plans = cpus.map(|(threads, fixed)| test(problem, threads, fixed, amounts));
    placed.plans = plans.collect();
    placed
}

fn empty(problem: &Problem<'_>) -> Placed {
    let cpus = &problem.request.machine.cpus;
    let on_cpu = |cpu: &usize| {
        let fixed = problem.fixed.iter().enumerate();
        let here = fixed.filter(|(_, (_, at, _))| at.is_none_or(|at| at == *cpu));
        here.map(|(index, _)| index).collect()
    };
    Placed {
        on: vec![Vec::new(); cpus.len()],
        fixed: cpus.iter().map(on_cpu).collect(),
        plans: Vec::new(),
    }
}

/// Pinned ones first, then by falling share, then in order.
fn order(problem: &Problem<'_>, include: &[usize], amounts: &[Nanos]) -> Vec<usize> {
    let mut order = include.to_vec();
    let share = |i: usize| {
        let amount = amounts.get(i).copied().unwrap_or(0);
        seat(problem, i).map_or(0.0, |s| s.share(amount))
    };
    let pinned = |i: usize| seat(problem, i).is_some_and(|s| s.cpu.is_some());
    order.sort_by(|a, b| {
        pinned(*b)
            .cmp(&pinned(*a))
            .then(share(*b).total_cmp(&share(*a)))
            .then(a.cmp(b))
    });
    order
}

fn cpu_at(problem: &Problem<'_>, index: usize) -> Option<usize> {
    let wanted = seat(problem, index)?.cpu?;
    problem
        .request
        .machine
        .cpus
        .iter()
        .position(|c| *c == wanted)
}

/// The CPU of the workers that it shares locks with, if one of them has its CPU already.
fn beside(problem: &Problem<'_>, placed: &Placed, index: usize) -> Option<usize> {
    let together = seat(problem, index)?.together?;
    let has = |i: &usize| seat(problem, *i).is_some_and(|s| s.together == Some(together));
    placed.on.iter().position(|here| here.iter().any(has))
}

fn worst_fit(problem: &Problem<'_>, include: &[usize], amounts: &[Nanos]) -> Placed {
    let mut placed = empty(problem);
    let test_fixed = |fixed: &Vec<usize>| test(problem, &[], fixed, amounts).share;
    let mut load: Vec<f64> = placed.fixed.iter().map(test_fixed).collect();
    for index in order(problem, include, amounts) {
        let least = || {
            let loads = load.iter().enumerate();
            loads.min_by(|a, b| a.1.total_cmp(b.1)).map(|(at, _)| at)
        };
        let at = cpu_at(problem, index).or_else(|| beside(problem, &placed, index));
        let Some(at) = at.or_else(least) else {
            continue;
        };
        if let (Some(here), Some(load)) = (placed.on.get_mut(at), load.get_mut(at)) {
            here.push(index);
            let amount = amounts.get(index).copied().unwrap_or(0);
            *load += seat(problem, index).map_or(0.0, |s| s.share(amount));
        }
    }
    placed
        .on
        .iter_mut()
        .for_each(|threads| threads.sort_unstable());
    placed
}

fn first_fit(problem: &Problem<'_>, include: &[usize], amounts: &[Nanos]) -> Option<Placed> {
    let mut placed = empty(problem);
    let holds = |threads: &[usize], fixed: &[usize]| holds(problem, threads, fixed, amounts);
    if !placed.fixed.iter().all(|fixed| holds(&[], fixed)) {
        return None;
    }
    for index in order(problem, include, amounts) {
        let at = cpu_at(problem, index).or_else(|| beside(problem, &placed, index));
        let cpus: Vec<usize> = match at {
            Some(at) => vec![at],
            None => (0..placed.on.len()).collect(),
        };
        let fits = |at: &usize| {
            let mut threads = placed.on.get(*at)?.clone();
            threads.push(index);
            threads.sort_unstable();
            holds(&threads, placed.fixed.get(*at)?).then_some((*at, threads))
        };
        let (at, threads) = cpus.iter().find_map(fits)?;
        *placed.on.get_mut(at)? = threads;
    }
    Some(placed)
}

/// Whom a failure on the CPU at `at` is about.
pub(super) fn whose(
    problem: &Problem<'_>,
    placed: &Placed,
    at: usize,
    victim: Victim,
) -> Option<Whose> {
    match victim {
        Victim::Sum => None,
        Victim::Planned(place) => {
            let index = placed.on.get(at)?.get(place)?;
            problem.threads.get(*index).map(|(whose, _)| *whose)
        }
        Victim::Given(place) => {
            let index = placed.fixed.get(at)?.get(place)?;
            problem.fixed.get(*index).map(|(whose, _, _)| *whose)
        }
    }
}
