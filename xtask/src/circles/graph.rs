//! Circles in a directed graph: its strongly connected components of two nodes or more.

use std::collections::BTreeSet;

/// The circles, each as the set of its nodes. Nodes are `0..count`.
pub(super) fn circles(
    count: usize,
    arrows: impl Iterator<Item = (usize, usize)>,
) -> Vec<BTreeSet<usize>> {
    let (mut forward, mut backward) = (vec![Vec::new(); count], vec![Vec::new(); count]);
    for (from, to) in arrows {
        forward[from].push(to);
        backward[to].push(from);
    }
    let mut left: BTreeSet<usize> = (0..count).collect();
    let mut circles = Vec::new();
    while let Some(node) = left.first().copied() {
        let back = reach(node, &backward);
        let both: BTreeSet<_> = reach(node, &forward).intersection(&back).copied().collect();
        left.retain(|node| !both.contains(node));
        if both.len() > 1 {
            circles.push(both);
        }
    }
    circles
}

/// `start` and the nodes that arrows lead to from there.
fn reach(start: usize, arrows: &[Vec<usize>]) -> BTreeSet<usize> {
    let (mut reached, mut next) = (BTreeSet::new(), vec![start]);
    while let Some(node) = next.pop() {
        if reached.insert(node) {
            next.extend(&arrows[node]);
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_is_found_and_what_hangs_on_it_is_not_part_of_it() {
        let arrows = [
            (0, 1),
            (1, 2),
            (2, 1),
            (2, 3),
            (4, 5),
            (5, 6),
            (6, 4),
            (3, 7),
        ];
        let found = circles(8, arrows.into_iter());
        assert_eq!(found, [BTreeSet::from([1, 2]), BTreeSet::from([4, 5, 6])]);
    }
}
