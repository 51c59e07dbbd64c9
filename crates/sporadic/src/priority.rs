//! One rule for the priorities of budgets, for the planner and for executors without it.
//!
//! Deadline-monotonic (Leung and Whitehead, 1982): the earlier the deadline, the higher the
//! priority, and equal deadlines share one. [`by_rank`] is the rule. An executor without a planner
//! applies it as it is, to the periods. `replenish-plan` starts from the same ranks and leaves gaps
//! between them, so that programs that know nothing of each other find places among themselves.

use core::ops::RangeInclusive;

/// The priority of the deadline that has `earlier` distinct earlier ones, of `count` in all.
///
/// The earliest gets the highest priority of the range and each later one the next below. Where
/// there are more deadlines than priorities, neighbours share. A caller that does not know the
/// count says `earlier + 1`: then all that find no priority of their own share the lowest.
#[must_use]
pub fn by_rank(range: &RangeInclusive<u8>, earlier: usize, count: usize) -> u8 {
    let (low, high) = (*range.start(), *range.end());
    let room = usize::from(high.saturating_sub(low)) + 1;
    let down = if count > room {
        earlier.saturating_mul(room) / count
    } else {
        earlier
    };
    high.saturating_sub(u8::try_from(down).unwrap_or(u8::MAX))
        .max(low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_later_deadline_has_the_next_priority_down_to_the_lowest() {
        for (earlier, priority) in [(0, 60), (1, 59), (40, 20), (41, 20), (10_000, 20)] {
            assert_eq!(by_rank(&(20..=60), earlier, earlier + 1), priority);
        }
    }

    #[test]
    fn neighbours_share_where_there_are_more_deadlines_than_priorities() {
        let all: [u8; 100] = core::array::from_fn(|at| by_rank(&(20..=29), at, 100));
        assert!(all.is_sorted_by(|a, b| a >= b));
        assert!((20..=29).all(|p| all.iter().filter(|has| **has == p).count() == 10));
    }
}
