//! Bounded queues of many endpoints that take turns: one sample each, so that a backlog of one
//! delays the others by one sample only.
//!
//! ```text
//!   push ──► queue of its id ── full: the oldest goes ──► pop: the next id in turn
//!                                                          ▲ paused ones stand aside
//! ```

use std::collections::{HashMap, VecDeque};

/// Bytes that count against the bound of a queue.
pub(crate) trait Weight {
    fn weight(&self) -> usize;
}

/// Queues by id.
#[derive(Debug)]
pub(crate) struct Queues<T> {
    queues: HashMap<u64, Queue<T>>,
    turns: VecDeque<u64>,
    depth: usize,
    bytes: usize,
    room: usize,
}

#[derive(Debug)]
struct Queue<T> {
    waiting: VecDeque<T>,
    /// It stands in the turns.
    queued: bool,
    paused: bool,
}

impl<T> Queue<T> {
    fn new() -> Self {
        Self {
            waiting: VecDeque::new(),
            queued: false,
            paused: false,
        }
    }
}

impl<T: Weight> Queues<T> {
    /// Queues of up to `depth` each and `room` bytes together.
    pub(crate) fn new(depth: usize, room: usize) -> Self {
        Self {
            queues: HashMap::new(),
            turns: VecDeque::new(),
            depth: depth.max(1),
            bytes: 0,
            room,
        }
    }

    /// Adds something to the end of its queue; returns how many were dropped for it, the item
    /// itself included.
    pub(crate) fn push(&mut self, id: u64, item: T) -> u64 {
        let weight = item.weight();
        let queue = self.queues.entry(id).or_insert_with(Queue::new);
        let mut dropped = 0;
        while queue.waiting.len() >= self.depth || self.bytes + weight > self.room {
            let Some(oldest) = queue.waiting.pop_front() else {
                return dropped + 1; // the others take all the room
            };
            self.bytes -= oldest.weight();
            dropped += 1;
        }
        self.bytes += weight;
        queue.waiting.push_back(item);
        if !queue.queued && !queue.paused {
            queue.queued = true;
            self.turns.push_back(id);
        }
        dropped
    }

    /// The next in turn.
    pub(crate) fn pop(&mut self) -> Option<(u64, T)> {
        while let Some(id) = self.turns.pop_front() {
            let Some(queue) = self.queues.get_mut(&id) else {
                continue;
            };
            queue.queued = false;
            if queue.paused {
                continue;
            }
            let Some(item) = queue.waiting.pop_front() else {
                continue;
            };
            self.bytes -= item.weight();
            if !queue.waiting.is_empty() {
                queue.queued = true;
                self.turns.push_back(id);
            }
            return Some((id, item));
        }
        None
    }

    /// Puts back the item that was just popped.
    pub(crate) fn push_front(&mut self, id: u64, item: T) {
        if let Some(queue) = self.queues.get_mut(&id) {
            self.bytes += item.weight();
            queue.waiting.push_front(item);
            if !queue.queued && !queue.paused {
                queue.queued = true;
                self.turns.push_back(id);
            }
        }
    }

    /// Takes no more from this queue until it is resumed.
    pub(crate) fn pause(&mut self, id: u64) {
        let queue = self.queues.entry(id).or_insert_with(Queue::new);
        queue.paused = true;
        queue.queued = false;
        self.turns.retain(|turn| *turn != id);
    }

    /// Takes from this queue again.
    pub(crate) fn resume(&mut self, id: u64) {
        if let Some(queue) = self.queues.get_mut(&id) {
            queue.paused = false;
            if !queue.queued && !queue.waiting.is_empty() {
                queue.queued = true;
                self.turns.push_back(id);
            }
        }
    }

    /// Drops a queue with what waits in it.
    pub(crate) fn remove(&mut self, id: u64) {
        if let Some(queue) = self.queues.remove(&id) {
            self.bytes -= queue.waiting.iter().map(Weight::weight).sum::<usize>();
            self.turns.retain(|turn| *turn != id);
        }
    }

    /// The number of samples that wait for `id`.
    pub(crate) fn len(&self, id: u64) -> usize {
        self.queues.get(&id).map_or(0, |queue| queue.waiting.len())
    }

    /// Whether there is something to pop.
    pub(crate) fn is_empty(&self) -> bool {
        self.turns.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Weight for &str {
        fn weight(&self) -> usize {
            str::len(self)
        }
    }

    fn all(queues: &mut Queues<&'static str>) -> Vec<(u64, &'static str)> {
        std::iter::from_fn(|| queues.pop()).collect()
    }

    #[test]
    fn queues_take_turns_and_each_keeps_its_order() {
        let mut queues = Queues::new(8, 100);
        for (id, item) in [(1, "a"), (1, "b"), (1, "c"), (2, "x"), (3, "y"), (2, "z")] {
            assert_eq!(queues.push(id, item), 0);
        }
        let expected = [(1, "a"), (2, "x"), (3, "y"), (1, "b"), (2, "z"), (1, "c")];
        assert_eq!(all(&mut queues), expected);
        assert!(queues.is_empty() && queues.bytes == 0);
    }

    #[test]
    fn the_oldest_of_the_same_queue_goes() {
        let mut queues = Queues::new(2, 5);
        assert_eq!(queues.push(1, "a"), 0);
        assert_eq!(queues.push(1, "b"), 0);
        assert_eq!(queues.push(1, "c"), 1);
        assert_eq!(queues.push(2, "1234"), 1, "no room: 2 bytes of another");
        assert_eq!(queues.push(2, "123"), 0);
        assert_eq!(queues.push(2, "12"), 1);
        assert_eq!(all(&mut queues), [(1, "b"), (2, "12"), (1, "c")]);
    }

    #[test]
    fn a_paused_queue_keeps_what_it_has() {
        let mut queues = Queues::new(4, 100);
        queues.push(1, "a");
        queues.push(1, "b");
        queues.push(2, "x");
        assert_eq!(queues.pop(), Some((1, "a")));
        queues.pause(1);
        queues.push(1, "c");
        assert_eq!(all(&mut queues), [(2, "x")]);
        queues.resume(1);
        assert_eq!(all(&mut queues), [(1, "b"), (1, "c")]);
        queues.push(1, "d");
        queues.push(1, "e");
        assert_eq!(queues.pop(), Some((1, "d")));
        queues.push_front(1, "d");
        assert_eq!(queues.pop(), Some((1, "d")));
        queues.remove(1);
        assert_eq!((all(&mut queues), queues.bytes), (vec![], 0));
    }
}
