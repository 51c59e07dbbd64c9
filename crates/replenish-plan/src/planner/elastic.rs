//! Giving more than the minimum: desired amounts by importance, while it fits.

use super::assign::{self, Placed};
use super::problem::Problem;
use super::search::search;
use crate::Nanos;
use crate::span::step;

/// Bounds the tests of a CPU, so that large sets stay quick: this over the square of its threads.
const WORK: usize = 40_000;

/// Raises `amounts` towards `desired` on every CPU of `placed`, which holds. Most important first;
/// each gets all it desires or the largest amount that fits, then the next has its turn.
pub(super) fn grow(
    problem: &Problem<'_>,
    placed: &mut Placed,
    amounts: &mut [Nanos],
    desired: &[Nanos],
) {
    for at in 0..placed.on.len() {
        let (Some(threads), Some(fixed)) = (placed.on.get(at), placed.fixed.get(at)) else {
            continue;
        };
        let mut wanting: Vec<usize> = threads
            .iter()
            .copied()
            .filter(|i| desired.get(*i) > amounts.get(*i))
            .collect();
        let importance = |i: &usize| problem.threads.get(*i).map_or(0, |(_, s)| s.importance);
        wanting.sort_by_key(|i| (core::cmp::Reverse(importance(i)), *i));
        let mut tests = WORK / (threads.len() * threads.len()).max(1);
        let mut rest = wanting.as_slice();
        while !rest.is_empty() && tests > 0 {
            let mut holds = |amounts: &[Nanos]| {
                tests = tests.saturating_sub(1);
                assign::holds(problem, threads, fixed, amounts)
            };
            let whole = prefix(rest, amounts, desired, &mut holds);
            for &index in rest.iter().take(whole) {
                set(amounts, index, desired.get(index).copied());
            }
            let Some(&next) = rest.get(whole) else { break };
            part(next, amounts, desired, &mut holds);
            rest = rest.get(whole + 1..).unwrap_or_default();
        }
        let plan = assign::test(problem, threads, fixed, amounts);
        if let Some(known) = placed.plans.get_mut(at) {
            *known = plan;
        }
    }
}

fn set(amounts: &mut [Nanos], index: usize, value: Option<Nanos>) {
    if let (Some(amount), Some(value)) = (amounts.get_mut(index), value) {
        *amount = value;
    }
}

/// Number of the first workers that can have all they desire.
fn prefix(
    wanting: &[usize],
    amounts: &[Nanos],
    desired: &[Nanos],
    holds: &mut impl FnMut(&[Nanos]) -> bool,
) -> usize {
    let mut with = |count: usize| {
        let mut trial = amounts.to_vec();
        for &index in wanting.iter().take(count) {
            set(&mut trial, index, desired.get(index).copied());
        }
        holds(&trial)
    };
    if with(wanting.len()) {
        return wanting.len();
    }
    search(0, wanting.len() as u64, |count| with(count as usize)) as usize
}

/// The largest amount between what it has and what it desires, in round numbers.
fn part(
    index: usize,
    amounts: &mut [Nanos],
    desired: &[Nanos],
    holds: &mut impl FnMut(&[Nanos]) -> bool,
) {
    let (Some(&has), Some(&wants)) = (amounts.get(index), desired.get(index)) else {
        return;
    };
    let step = step(wants, 3);
    let good = search(0, (wants - has).div_ceil(step), |steps| {
        set(amounts, index, Some(has + steps * step));
        holds(amounts)
    });
    set(amounts, index, Some(has + good * step));
}
