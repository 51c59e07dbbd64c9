//! The readers of a stream: the highest priority first, equals in weighted turns.

use crate::config::{LEVELS, Service};
use replenish_xrce::wire::ObjectId;
use std::collections::VecDeque;

/// The readers that have samples for a stream, each once.
#[derive(Debug, Default)]
pub(crate) struct WeightedRoundRobin {
    levels: [VecDeque<Turn>; LEVELS],
    /// Bit `n` is set iff level `n` is not empty.
    occupied: u8,
}

#[derive(Debug)]
struct Turn {
    reader: ObjectId,
    weight: u16,
    /// Samples that are left of this turn.
    left: u16,
}

impl WeightedRoundRobin {
    /// Gives `reader` a turn.
    pub(crate) fn queue(&mut self, reader: ObjectId, service: Service) {
        let level = service.priority;
        let Some(turns) = self.levels.get_mut(usize::from(level)) else {
            return;
        };
        if turns.iter().all(|turn| turn.reader != reader) {
            turns.push_back(Turn {
                reader,
                weight: service.weight,
                left: service.weight,
            });
            self.occupied |= 1 << level;
        }
    }

    /// Removes `reader`.
    pub(crate) fn forget(&mut self, reader: ObjectId) {
        for turns in &mut self.levels {
            turns.retain(|turn| turn.reader != reader);
        }
        self.note();
    }

    /// The highest priority among the waiting readers.
    pub(crate) fn top(&self) -> Option<u8> {
        let level = 7_u32.checked_sub(self.occupied.leading_zeros())?;
        u8::try_from(level).ok()
    }

    /// The reader whose turn it is.
    pub(crate) fn front(&self) -> Option<ObjectId> {
        let level = self.top()?;
        let turn = self.levels.get(usize::from(level))?.front()?;
        Some(turn.reader)
    }

    /// Ends a sample's turn of the front reader, which stays only if it has `more`.
    pub(crate) fn served(&mut self, more: bool) {
        let Some(turns) = self
            .top()
            .and_then(|level| self.levels.get_mut(usize::from(level)))
        else {
            return;
        };
        match turns.front_mut() {
            Some(turn) if more && turn.left > 1 => turn.left -= 1,
            _ => {
                if let Some(turn) = turns.pop_front().filter(|_| more) {
                    let left = turn.weight;
                    turns.push_back(Turn { left, ..turn });
                }
                self.note();
            }
        }
    }

    fn note(&mut self) {
        self.occupied = 0;
        for (level, turns) in self.levels.iter().enumerate() {
            self.occupied |= u8::from(!turns.is_empty()) << level;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reader(number: u8) -> ObjectId {
        ObjectId::from_bytes([number, 0x06])
    }

    fn at(priority: u8, weight: u16) -> Service {
        Service { priority, weight }
    }

    fn order(turns: &mut WeightedRoundRobin, count: usize) -> Vec<u8> {
        let next = |_| {
            let [number, _] = turns.front().unwrap().to_bytes();
            turns.served(true);
            number
        };
        (0..count).map(next).collect()
    }

    #[test]
    fn equals_take_turns_by_weight() {
        let mut turns = WeightedRoundRobin::default();
        turns.queue(reader(1), at(4, 1));
        turns.queue(reader(2), at(4, 3));
        turns.queue(reader(2), at(4, 3));
        assert_eq!(order(&mut turns, 8), [1, 2, 2, 2, 1, 2, 2, 2]);
    }

    #[test]
    fn the_more_urgent_goes_first_until_it_has_nothing_left() {
        let mut turns = WeightedRoundRobin::default();
        assert_eq!(turns.top(), None);
        turns.queue(reader(1), at(0, 1));
        turns.queue(reader(2), at(7, 1));
        assert_eq!(turns.top(), Some(7));
        assert_eq!(order(&mut turns, 3), [2, 2, 2]);
        turns.served(false);
        assert_eq!((turns.top(), turns.front()), (Some(0), Some(reader(1))));
        turns.forget(reader(1));
        assert_eq!((turns.top(), turns.front()), (None, None));
    }
}
