//! Whether every bound is within its limit: yes or no, without the bounds.

use super::interference::Interference;
use super::response::{bound, locks, longest, unfounded_up_to};
use super::{Bounds, Costs, Scheduling, Task};
use crate::Nanos;

/// The limits for one task's [`Bounds`]; `None`: no limit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Limit {
    /// The largest [`Bounds::service`], in ns.
    pub service: Option<Nanos>,
    /// The largest [`Bounds::response`], in ns.
    pub response: Option<Nanos>,
}

impl Limit {
    /// Whether these bounds are within the limit; one that does not exist is not.
    #[must_use]
    pub fn allows(&self, bounds: &Bounds) -> bool {
        let within = |limit: Option<Nanos>, bound: Option<Nanos>| {
            limit.is_none_or(|limit| bound.is_some_and(|bound| bound <= limit))
        };
        within(self.service, bounds.service) && within(self.response, bounds.response)
    }
}

/// Whether all [`bounds`](super::bounds) of `tasks` are within these limits, in their order.
///
/// The same answer, several times as fast for reservations of which only the service is asked:
/// one sum at the limit is enough for most of them. The least urgent come first, which are the
/// first to be late.
pub fn within(tasks: &[Task], costs: &Costs, limits: &[Limit]) -> bool {
    let longest = longest(tasks);
    let locks = locks(tasks, costs, longest);
    let whole = |index| bound(tasks, index, costs, &locks, longest);
    // A task that suspends itself and may end late takes the bounds of others away.
    let suspending = (0..tasks.len()).filter(|index| tasks[*index].suspends());
    let unfounded = suspending.filter_map(|index| unfounded_up_to(&tasks[index], &whole(index)));
    let unfounded = unfounded.max();
    let mut order: Vec<usize> = (0..tasks.len().min(limits.len())).collect();
    order.sort_by_key(|index| tasks[*index].priority());
    order.into_iter().all(|index| {
        let (task, limit) = (&tasks[index], &limits[index]);
        if *limit == Limit::default() {
            return true;
        }
        if unfounded.is_some_and(|highest| task.priority() <= highest) {
            return false;
        }
        match (task.scheduling, limit.service, limit.response) {
            // Up to a period the first window decides.
            (Scheduling::Reserved(params), Some(allowed), None) if allowed <= params.period() => {
                let Some(window) = allowed.checked_sub(costs.raise_delay()) else {
                    return false;
                };
                Interference::of(tasks, index, costs, &locks).is_some_and(|interference| {
                    interference.fits(params.budget(), window.min(longest))
                })
            }
            _ => limit.allows(&whole(index)),
        }
    })
}
