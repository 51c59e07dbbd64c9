//! The other users of a CPU, in the words of a refusal: programs, and the user's own workers.

use super::assign::{self, Placed};
use super::problem::{Problem, Whose};

/// The most of the user's own workers that a refusal names.
const NAMED: usize = 3;

/// The parts of the share: ` (60.0 % by other programs: …; 25.0 % by worker "b")`. Empty if
/// `newcomer` is alone.
pub(super) fn shares(problem: &Problem<'_>, placed: &Placed, at: usize, newcomer: Whose) -> String {
    let own = own(problem, placed, at, newcomer);
    let own = list(&own, |name, share| format!("{share} by {name}"));
    let parts = [others(problem, placed, at), own];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    if parts.is_empty() {
        return String::new();
    }
    format!(" ({})", parts.join("; "))
}

/// The user's own workers there: `, beside worker "b" (25.0 %) and the executor (5.1 %)`.
pub(super) fn beside(problem: &Problem<'_>, placed: &Placed, at: usize, victim: Whose) -> String {
    let own = own(problem, placed, at, victim);
    let own = list(&own, |name, share| format!("{name} ({share})"));
    own.map_or_else(String::new, |own| format!(", beside {own}"))
}

/// A share of a CPU for people, in percent: rounded up, so that too much never looks allowed.
pub(crate) fn percent(share: f64) -> String {
    // A share of 0.3 is a little more than 30 % to the processor; less than nothing has a sign.
    let tenths = (share * 1000.0 - 1e-6).ceil();
    let tenths = if tenths > 0.0 { tenths } else { 0.0 };
    format!("{:.1} %", tenths / 10.0)
}

/// A part of what is reserved, in percent.
fn part(share: f64) -> String {
    format!("{:.1} %", share * 100.0)
}

/// The largest first, those that are not named counted.
fn list(own: &[(String, f64)], say: impl Fn(&str, String) -> String) -> Option<String> {
    let shown: Vec<String> = own
        .iter()
        .take(NAMED)
        .map(|(name, share)| say(name, part(*share)))
        .collect();
    match (shown.as_slice(), own.len().saturating_sub(NAMED)) {
        ([], _) => None,
        ([one], _) => Some(one.clone()),
        ([first @ .., last], 0) => Some(format!("{} and {last}", first.join(", "))),
        (all, more) => Some(format!("{} and {more} more", all.join(", "))),
    }
}

/// The program's own threads on this CPU but one, with their shares, the largest first.
fn own(problem: &Problem<'_>, placed: &Placed, at: usize, but: Whose) -> Vec<(String, f64)> {
    let enforcement = problem.request.machine.overheads.enforcement;
    let params = placed.plans.get(at).map_or(&[][..], |plan| &plan.params);
    let planned = placed.on.get(at).map_or(&[][..], Vec::as_slice).iter();
    let planned = planned.zip(params).filter_map(|(index, params)| {
        let (whose, _) = problem.threads.get(*index)?;
        let budget = params.budget().saturating_add(enforcement);
        Some((*whose, budget as f64 / params.period().max(1) as f64))
    });
    let fixed = placed.fixed.get(at).map_or(&[][..], Vec::as_slice).iter();
    let fixed = fixed.filter_map(|index| {
        let (whose, _, _) = problem.fixed.get(*index)?;
        Some((*whose, assign::test(problem, &[], &[*index], &[]).share))
    });
    let own = |(whose, share): &(Whose, f64)| {
        !matches!(whose, Whose::Promise(_)) && *whose != but && *share > 0.0
    };
    let mut all: Vec<(String, f64)> = planned
        .chain(fixed)
        .filter(own)
        .map(|(whose, share)| (problem.name(whose), share))
        .collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

/// The part of it that other programs have, if any.
fn others(problem: &Problem<'_>, placed: &Placed, at: usize) -> Option<String> {
    let fixed = placed.fixed.get(at).map_or(&[][..], Vec::as_slice);
    let promised = |i: &usize| {
        let (whose, _, _) = problem.fixed.get(*i)?;
        matches!(whose, Whose::Promise(_)).then_some((*i, *whose))
    };
    let promised: Vec<(usize, Whose)> = fixed.iter().filter_map(promised).collect();
    let (_, first) = promised.first()?;
    let indices: Vec<usize> = promised.iter().map(|(i, _)| *i).collect();
    let share = assign::test(problem, &[], &indices, &[]).share;
    let more = match promised.len() {
        1 => String::new(),
        n => format!(" and {} more", n - 1),
    };
    Some(format!(
        "{} by other programs: {}{more}",
        part(share),
        problem.name(*first)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_rounded_up() {
        for (share, said) in [
            (0.3, "30.0 %"),
            (0.95, "95.0 %"),
            (0.95001, "95.1 %"),
            (0.0, "0.0 %"),
        ] {
            assert_eq!(percent(share), said);
        }
    }

    #[test]
    fn the_largest_are_named_and_the_rest_is_counted() {
        let of = |names: &[&str]| {
            let own: Vec<_> = names.iter().map(|n| (n.to_string(), 0.1)).collect();
            list(&own, |name, _| name.into())
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&["a"]).as_deref(), Some("a"));
        assert_eq!(of(&["a", "b"]).as_deref(), Some("a and b"));
        assert_eq!(of(&["a", "b", "c"]).as_deref(), Some("a, b and c"));
        assert_eq!(
            of(&["a", "b", "c", "d", "e"]).as_deref(),
            Some("a, b, c and 2 more")
        );
    }
}
