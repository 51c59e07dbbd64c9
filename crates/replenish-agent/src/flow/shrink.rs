//! Queues and tables that give memory back once most of it is unused: what a client has given back
//! on its account must be free for others.

use std::collections::{HashMap, VecDeque};
use std::hash::Hash;

/// Places that are kept however few are used.
const LEAST: usize = 8;

/// Places for each one that is in use, at most, above [`LEAST`].
pub(crate) const SPARE: usize = 4;

const fn is_mostly_unused(len: usize, capacity: usize) -> bool {
    capacity > LEAST && len * SPARE < capacity
}

/// Removes the oldest.
pub(crate) fn pop_front<T>(queue: &mut VecDeque<T>) -> Option<T> {
    let front = queue.pop_front();
    if is_mostly_unused(queue.len(), queue.capacity()) {
        queue.shrink_to(queue.capacity() / 2);
    }
    front
}

/// Keeps those that `keep` says.
pub(crate) fn retain<T>(list: &mut Vec<T>, keep: impl FnMut(&T) -> bool) {
    list.retain(keep);
    if is_mostly_unused(list.len(), list.capacity()) {
        list.shrink_to(list.capacity() / 2);
    }
}

/// Removes an entry.
pub(crate) fn remove<K: Eq + Hash, V>(table: &mut HashMap<K, V>, key: &K) -> Option<V> {
    let value = table.remove(key);
    if is_mostly_unused(table.len(), table.capacity()) {
        table.shrink_to(table.capacity() / 2);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_given_back_and_what_is_left_is_in_order() {
        let mut queue: VecDeque<u32> = (0..10_000).collect();
        let mut list: Vec<u32> = (0..10_000).collect();
        let mut table: HashMap<u32, u32> = (0..10_000).map(|n| (n, n)).collect();
        for n in 0..9_990 {
            assert_eq!(pop_front(&mut queue), Some(n));
            if n % 100 == 0 {
                retain(&mut list, |left| *left >= n);
            }
            assert_eq!(remove(&mut table, &n), Some(n));
            let most = SPARE * queue.len().max(LEAST);
            assert!(queue.capacity() <= most, "{n}: {}", queue.capacity());
        }
        retain(&mut list, |left| *left >= 9_990);
        retain(&mut list, |_| true);
        assert!(queue.iter().copied().eq(9_990..10_000));
        assert_eq!((list.len(), table.len()), (10, 10));
        assert!(table.capacity() <= 100 && list.capacity() <= 200);
    }
}
