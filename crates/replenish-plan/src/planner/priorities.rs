//! Priorities from deadlines, on a scale that programs share without knowing each other.

use crate::Nanos;
use sporadic::priority::by_rank;
use std::ops::RangeInclusive;

/// The deadline that has the highest level.
const SHORTEST: Nanos = 100_000;
/// The deadline that has the lowest level.
const LONGEST: Nanos = 10_000_000_000;

/// The level that belongs to a deadline: the range is spread over 100 us to 10 s, logarithmically.
/// So an earlier deadline never has a lower level (deadline-monotonic order, Leung and Whitehead
/// 1982), and a program that comes later finds its place among those that run.
pub(super) fn level_of(deadline: Nanos, range: &RangeInclusive<u8>) -> u8 {
    let (low, high) = (*range.start(), *range.end());
    let width = u64::from(high.saturating_sub(low));
    let above = log2(deadline.clamp(SHORTEST, LONGEST)) - log2(SHORTEST);
    let whole = log2(LONGEST) - log2(SHORTEST);
    let down = (above * width + whole / 2) / whole;
    high.saturating_sub(u8::try_from(down).unwrap_or(u8::MAX))
}

/// 256 times the logarithm to the base 2, with a straight line between powers of two: the same on
/// every machine.
fn log2(value: u64) -> u64 {
    let power = value.max(1).ilog2();
    let fraction = (u128::from(value) << 8) >> power;
    u64::from(power) * 256 + (fraction as u64 & 255)
}

/// A level per deadline; equal deadlines get equal levels, and an earlier deadline a higher level
/// as far as there are levels. `taken`: levels and deadlines of others, which are kept clear of.
pub(super) fn assign(
    deadlines: &[Nanos],
    range: &RangeInclusive<u8>,
    taken: &[(u8, Nanos)],
) -> Vec<u8> {
    let mut distinct = deadlines.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    let (low, high) = (i32::from(*range.start()), i32::from(*range.end()));
    let room = usize::try_from(high - low + 1).unwrap_or(0);
    let count = distinct.len();
    let mut levels: Vec<u8> = Vec::with_capacity(count);
    let mut ceiling = high;
    for (index, &deadline) in distinct.iter().enumerate() {
        if count > room {
            levels.push(by_rank(range, index, count));
            continue;
        }
        let floor = low + i32::try_from(count - 1 - index).unwrap_or(0);
        let wanted = i32::from(level_of(deadline, range));
        let level = clear_of(
            wanted.clamp(floor, ceiling),
            floor,
            ceiling,
            deadline,
            taken,
        );
        levels.push(clamp(level));
        ceiling = level - 1;
    }
    let level_at = |deadline: &Nanos| {
        let at = distinct.binary_search(deadline).unwrap_or(0);
        levels.get(at).copied().unwrap_or(*range.start())
    };
    deadlines.iter().map(level_at).collect()
}

/// The nearest level to `level` that no other deadline has, on the right side first.
fn clear_of(level: i32, floor: i32, ceiling: i32, deadline: Nanos, taken: &[(u8, Nanos)]) -> i32 {
    let at = |level: i32| {
        taken
            .iter()
            .find(|(l, d)| i32::from(*l) == level && *d != deadline)
    };
    let Some((_, other)) = at(level) else {
        return level;
    };
    let side = if *other < deadline { -1 } else { 1 };
    let free = |l: &i32| (floor..=ceiling).contains(l) && at(*l).is_none();
    let away = 1..=(ceiling - floor).max(0);
    let near = away.flat_map(|by| [level + side * by, level - side * by]);
    near.into_iter().find(free).unwrap_or(level)
}

fn clamp(level: i32) -> u8 {
    u8::try_from(level.max(1)).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Nanos = 1_000_000;

    #[test]
    fn the_scale_runs_from_100_us_to_10_s() {
        let level = |d| level_of(d, &(20..=89));
        assert_eq!((level(1), level(100_000)), (89, 89));
        assert_eq!((level(10_000 * MS), level(Nanos::MAX)), (20, 20));
        assert!(level(10 * MS) > level(12 * MS) && level(12 * MS) > level(100 * MS));
    }

    #[test]
    fn earlier_deadlines_get_higher_levels_and_equal_ones_the_same() {
        let got = assign(&[100 * MS, 10 * MS, 100 * MS, 10 * MS + 1], &(20..=89), &[]);
        assert!(
            got[1] > got[3] && got[3] > got[0] && got[0] == got[2],
            "{got:?}"
        );
        let tight = assign(&[1, 2, 3], &(20..=22), &[]);
        assert_eq!(tight, [22, 21, 20]);
        let equal = assign(&[1, 1, 1, 1, 1, 2, 3], &(20..=22), &[]);
        assert_eq!(equal[4..], [22, 21, 20], "equal deadlines take one level");
        let many: Vec<_> = (1..=100).map(|i| i * MS).collect();
        let got = assign(&many, &(20..=29), &[]);
        assert!(got.is_sorted_by(|a, b| a >= b) && got[0] == 29 && got[99] == 20);
    }

    #[test]
    fn a_newcomer_fits_in_between() {
        let range = 20..=89;
        let level = level_of(10 * MS, &range);
        assert_eq!(assign(&[10 * MS], &range, &[(level, 10 * MS)]), [level]);
        assert_eq!(assign(&[10 * MS], &range, &[(level, 9 * MS)]), [level - 1]);
        assert_eq!(assign(&[10 * MS], &range, &[(level, 11 * MS)]), [level + 1]);
    }
}
