//! Requests that wait for their replies: a bounded table, oldest first.

use std::collections::VecDeque;

/// Requests by the key of their reply.
#[derive(Debug)]
pub(super) struct Calls<K, V> {
    waiting: VecDeque<(K, V)>,
    limit: usize,
}

impl<K: PartialEq, V> Calls<K, V> {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            waiting: VecDeque::new(),
            limit: limit.max(1),
        }
    }

    /// Remembers a request; returns whether an older one was forgotten for it.
    pub(super) fn add(&mut self, key: K, value: V) -> bool {
        let full = self.waiting.len() >= self.limit;
        if full {
            self.waiting.pop_front();
        }
        self.waiting.push_back((key, value));
        full
    }

    /// The request under `key`.
    pub(super) fn get(&self, key: &K) -> Option<&V> {
        let mut waiting = self.waiting.iter();
        waiting.find_map(|(known, value)| (known == key).then_some(value))
    }

    /// Takes out the request under `key`.
    pub(super) fn take(&mut self, key: &K) -> Option<V> {
        let at = self.waiting.iter().position(|(known, _)| known == key)?;
        self.waiting.remove(at).map(|(_, value)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_answered_once_and_the_oldest_is_forgotten() {
        let mut calls = Calls::new(2);
        assert!(!calls.add(1, 'a') && !calls.add(2, 'b') && calls.add(3, 'c'));
        assert_eq!((calls.take(&1), calls.get(&2)), (None, Some(&'b')));
        assert_eq!((calls.take(&3), calls.take(&3)), (Some('c'), None));
        assert_eq!(calls.take(&2), Some('b'));
    }
}
