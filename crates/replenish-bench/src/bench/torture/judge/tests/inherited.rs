//! The bounds of what a worker inherits.

use super::*;

/// docs/servers.md: a budget, what was inherited since the last lowering, and the section at whose
/// end the thread is stopped. Torture, seed 18: 28 us beyond a budget and a section.
#[test]
fn inherited_time_has_the_bound_of_a_budget_and_a_section() {
    let fine = evidence(&[(50, 0, 10), (70, 20, 32), (50, 210, 220)], 300);
    let background = in_a_group(Some(1));
    assert!(worst("window", &background, &fine) <= 0);
    assert!(worst("rate", &background, &fine) <= 0);
    let more = evidence(&[(50, 0, 10), (70, 20, 34), (50, 210, 220)], 300);
    assert!(worst("window", &background, &more) > 0);
    let suspended = in_a_group(None);
    assert!(worst("window", &suspended, &fine) > 0, "it finishes one");
    let one = evidence(&[(50, 0, 10), (70, 20, 22), (50, 110, 120)], 200);
    assert!(worst("window", &suspended, &one) <= 0);
}

/// docs/servers.md: a thread that cannot be raised counts as kept from the CPU. Torture, seed 514:
/// in the time-sharing class it had budget, and inherited time came in two sections of two budgets.
#[test]
fn a_suspended_worker_that_cannot_be_raised_may_inherit_its_budget() {
    let two = evidence(&[(70, 20, 32), (70, 100, 110)], 300);
    let mut case = in_a_group(None);
    assert!(worst("window", &case, &two) > 0);
    case.drops_at = Some(0);
    assert!(worst("window", &case, &two) <= 0);
    let more = evidence(&[(70, 20, 32), (70, 100, 112)], 300);
    assert!(worst("window", &case, &more) > 0);
}

/// Torture, seed 18: a section of 43 us with the interrupts of 8 checks and of the signal that
/// stops its thread took 200 us.
#[test]
fn a_section_is_longer_by_the_interrupts_that_hit_it() {
    let mut hit = evidence(&[(50, 0, 10), (70, 20, 22), (50, 110, 120)], 200);
    let suspended = in_a_group(None);
    let before = worst("window", &suspended, &hit);
    let at = hit.timeline.pieces.iter().position(|p| p.rank == 70);
    let whole = hit.timeline.pieces.remove(at.unwrap());
    let middle = whole.from + MS;
    let pieces = [(whole.from, middle), (middle, whole.to)].map(|(from, to)| Piece {
        from,
        to,
        cpu: MS + 10_000,
        ..whole
    });
    hit.timeline.pieces.splice(at.unwrap()..at.unwrap(), pieces);
    assert_eq!(
        worst("window", &suspended, &hit),
        before,
        "20 us more, for one more"
    );
}

/// The fault that the bound must still find: inherited time that nobody pays for.
#[test]
fn inherited_time_that_is_free_is_a_violation_of_the_rate() {
    let stretches: Vec<_> = (0..20)
        .flat_map(|n| {
            [
                (50, n * 100, n * 100 + 10),
                (70, n * 100 + 50, n * 100 + 52),
            ]
        })
        .collect();
    let free = evidence(&stretches, 2000);
    let case = in_a_group(Some(1));
    assert!(worst("window", &case, &free) <= 0);
    assert!(worst("rate", &case, &free) > 0);
}
