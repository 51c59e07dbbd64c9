//! The clients that can be sent something.

use crate::config::LEVELS;
use std::collections::VecDeque;

/// Clients that can be sent something, each once.
#[derive(Debug, Default)]
pub(super) struct ClientQueue {
    levels: [VecDeque<usize>; LEVELS],
}

impl ClientQueue {
    pub(super) fn join(&mut self, level: u8, index: usize) {
        if let Some(clients) = self.levels.get_mut(usize::from(level)) {
            clients.push_back(index);
        }
    }

    pub(super) fn leave(&mut self, level: u8, index: usize) {
        if let Some(clients) = self.levels.get_mut(usize::from(level)) {
            clients.retain(|waiting| *waiting != index);
        }
    }

    pub(super) fn next(&mut self) -> Option<usize> {
        self.levels.iter_mut().rev().find_map(VecDeque::pop_front)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.levels.iter().all(VecDeque::is_empty)
    }
}
