//! Reasons why a request is not admitted, in one sentence.

use super::alternatives::{self, Alternative};
use super::assign::{self, Placed};
use super::cpu::{Failure, Victim};
use super::describe::{describe, waits};
use super::locks::UNKNOWN;
use super::neighbours;
use super::plan::Plan;
use super::problem::{Problem, Whose};
use super::search::search;
use crate::Nanos;
use crate::span::Rounded;
use std::fmt;

/// A request that is not admitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// The worker that does not fit, if it is about one.
    pub worker: Option<String>,
    /// The CPU where it does not, if it is about one.
    pub cpu: Option<usize>,
    /// The sentence: the worker that does not fit, its CPU and the reason with numbers, and
    /// requests that would fit.
    pub sentence: String,
    /// Requests that would fit; each was tried.
    pub alternatives: Vec<Alternative>,
    /// The plan that was refused: for looking at, not for running.
    pub attempt: Option<Box<Plan>>,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence)
    }
}

impl std::error::Error for Refusal {}

impl Refusal {
    /// Stages that delay each other more and more.
    pub(crate) fn unsettled() -> Self {
        Self::invalid(
            "the chains do not settle: their stages delay each other without end; put them on different CPUs, or give one of them releases of its own"
                .into(),
        )
    }

    pub(super) fn invalid(sentence: String) -> Self {
        Self {
            worker: None,
            cpu: None,
            sentence,
            alternatives: Vec::new(),
            attempt: None,
        }
    }
}

/// Finds the first worker, most important first, with which it does not hold any more.
pub(super) fn refuse(problem: &Problem<'_>, amounts: &[Nanos], all: &Placed) -> Refusal {
    let mut order: Vec<usize> = (0..problem.threads.len()).collect();
    let importance = |i: usize| problem.threads.get(i).map_or(0, |(_, s)| s.importance);
    order.sort_by_key(|i| (core::cmp::Reverse(importance(*i)), *i));
    let first = |count: usize| order.get(..count).unwrap_or(&order);
    let attempt = describe(problem, all, amounts);
    let attempt = Some(Box::new(attempt));
    let nothing = assign::place(problem, &[], amounts);
    if let Some((at, failure)) = nothing.failure() {
        let sentence = alone(problem, &nothing, at, failure);
        return Refusal {
            cpu: problem.request.machine.cpus.get(at).copied(),
            attempt,
            ..Refusal::invalid(sentence)
        };
    }
    let good = search(0, order.len() as u64, |count| {
        assign::fits(problem, first(count as usize), amounts)
    }) as usize;
    let broken = if good + 1 < order.len() {
        assign::place(problem, first(good + 1), amounts)
    } else {
        all.clone()
    };
    let Some((whose, seat)) = order.get(good).and_then(|i| problem.threads.get(*i)) else {
        return Refusal::invalid("nothing was asked for".into());
    };
    let (at, failure) = broken.failure().unwrap_or((0, SUM));
    let cpu = problem.request.machine.cpus.get(at).copied();
    let (worker, fits) = match whose {
        Whose::Worker(index) => {
            let name = problem.request.workers.get(*index).map(|w| w.name.clone());
            let fits = name
                .as_deref()
                .map(|name| fits(problem, &order, good, name));
            (name, fits.unwrap_or_default())
        }
        _ => (None, Vec::new()),
    };
    let elsewhere = seat.cpu.is_none() && problem.request.machine.cpus.len() > 1;
    let mut sentence = format!(
        "{} does not fit{}: {}",
        problem.name(*whose),
        if elsewhere { " on any CPU" } else { "" },
        reason(problem, &broken, at, failure, *whose, elsewhere)
    );
    sentence += &advice(problem, &broken, at, failure, &fits);
    Refusal {
        worker,
        cpu,
        sentence,
        alternatives: fits,
        attempt,
    }
}

const SUM: Failure = Failure {
    victim: Victim::Sum,
    bound: None,
    allowed: 0,
};

/// Alternatives beside all other workers; if there are none, without the workers that come later.
fn fits(problem: &Problem<'_>, order: &[usize], refused: usize, name: &str) -> Vec<Alternative> {
    let found = alternatives::nearest(problem.request, name, &[]);
    let later = order.get(refused + 1..).unwrap_or_default();
    if !found.is_empty() || later.is_empty() {
        return found;
    }
    let names = later
        .iter()
        .filter_map(|i| match problem.threads.get(*i)?.0 {
            Whose::Worker(index) => problem.request.workers.get(index).map(|w| w.name.clone()),
            _ => None,
        });
    alternatives::nearest(problem.request, name, &names.collect::<Vec<_>>())
}

/// The reason for the refusal on this CPU.
fn reason(
    problem: &Problem<'_>,
    placed: &Placed,
    at: usize,
    failure: Failure,
    newcomer: Whose,
    nearest: bool,
) -> String {
    let cpu = problem.request.machine.cpus.get(at).copied().unwrap_or(0);
    let cpu = if nearest {
        format!("on CPU {cpu}, as good as any,")
    } else {
        format!("on CPU {cpu}")
    };
    let share = placed.plans.get(at).map_or(0.0, |plan| plan.share);
    let most = problem.request.machine.real_time_share * 100.0;
    let Some(victim) = assign::whose(problem, placed, at, failure.victim) else {
        let share = neighbours::percent(share);
        let whose = neighbours::shares(problem, placed, at, newcomer);
        return format!("{cpu} {share} would be reserved{whose}, {most:.0} % are allowed");
    };
    let who = if victim == newcomer {
        "it".into()
    } else {
        problem.name(victim)
    };
    let promised = match victim {
        Whose::Promise(_) => ", which is promised its time already,",
        _ => "",
    };
    let allowed = Rounded(failure.allowed);
    let waiting = waiting(problem, placed, at, victim);
    let beside = neighbours::beside(problem, placed, at, victim);
    match failure.bound {
        Some(bound) => format!(
            "{cpu} {who}{promised} could take up to {} where its deadline allows {allowed}{waiting}{beside}",
            Rounded(bound),
        ),
        None => {
            format!(
                "{cpu} {who}{promised} would not be certain to make its deadline of {allowed}{waiting}{beside}"
            )
        }
    }
}

/// The workers for which it would have to wait in its groups.
fn waiting(problem: &Problem<'_>, placed: &Placed, at: usize, victim: Whose) -> String {
    let index = problem
        .threads
        .iter()
        .position(|(whose, _)| *whose == victim);
    let (Some(index), Some(threads), Some(fixed)) =
        (index, placed.on.get(at), placed.fixed.get(at))
    else {
        return String::new();
    };
    let waits = waits(problem, threads, fixed, index);
    waits.iter().map(|wait| format!(" ({wait})")).collect()
}

/// A remedy.
fn advice(
    problem: &Problem<'_>,
    placed: &Placed,
    at: usize,
    failure: Failure,
    fits: &[Alternative],
) -> String {
    if failure.bound.is_none()
        && let Some(culprit) = unlimited(problem, placed, at)
    {
        return format!(
            ", since {culprit} runs there at a real-time priority without a budget; give that one a budget, a lower priority or another CPU"
        );
    }
    if failure.bound.is_none()
        && let Some((holder, lock)) = unknown(problem, placed, at)
    {
        return format!(
            ", since {holder} may hold group {lock:?} at a higher priority for a time that nobody has stated; state it (Group::holds; in a file: holds)"
        );
    }
    let said: Vec<String> = fits.iter().map(ToString::to_string).collect();
    let mut text = match said.as_slice() {
        [] => return "; no amount and no period up to 128 times as long would fit".into(),
        [one] => format!("; {one} would fit"),
        [one, other, ..] => format!("; {one} would fit, or {other}"),
    };
    if let Some(left_out) = fits.first().map(|f| &f.without).filter(|w| !w.is_empty()) {
        text += &match left_out.as_slice() {
            [one] => format!(", once {one} is left out"),
            [first, rest @ ..] => format!(", once {first} and {} more are left out", rest.len()),
            [] => String::new(),
        };
    }
    text
}

/// A thread on this CPU that holds a lock for a time that was not stated, if there is one.
fn unknown(problem: &Problem<'_>, placed: &Placed, at: usize) -> Option<(String, String)> {
    let planned = placed
        .on
        .get(at)?
        .iter()
        .filter_map(|i| problem.threads.get(*i));
    let planned = planned.map(|(whose, seat)| (*whose, &seat.sections));
    let given = placed.fixed.get(at)?.iter();
    let given = given.filter_map(|i| problem.fixed.get(*i));
    let mut all = planned.chain(given.map(|(whose, _, thread)| (*whose, &thread.sections)));
    all.find_map(|(whose, sections)| {
        let section = sections.iter().find(|s| s.length >= UNKNOWN)?;
        let lock = problem.request.locks.get(section.lock);
        Some((problem.name(whose), lock.cloned().unwrap_or_default()))
    })
}

/// A thread that may take this CPU for ever, if there is one.
fn unlimited(problem: &Problem<'_>, placed: &Placed, at: usize) -> Option<String> {
    let lowest = *problem.request.machine.priorities.start();
    let fixed = placed.fixed.get(at)?.iter();
    let mut fixed = fixed.filter_map(|i| problem.fixed.get(*i));
    let (whose, _, _) = fixed.find(|(_, _, f)| f.is_unlimited_above(lowest))?;
    Some(problem.name(*whose))
}

/// The sentence for a thread that does not hold even with only the unchangeable ones beside it.
fn alone(problem: &Problem<'_>, placed: &Placed, at: usize, failure: Failure) -> String {
    let what = reason(problem, placed, at, failure, Whose::Executor, false);
    format!(
        "the policies that are given do not fit: {what}{}",
        match unlimited(problem, placed, at) {
            Some(culprit) =>
                format!(", since {culprit} runs there at a real-time priority without a budget"),
            None => String::new(),
        }
    )
}
