//! The outcome of a handshake, for the error of a client that could not connect.

use std::sync::{Mutex, PoisonError};

/// The last thing that a transport has seen of its handshake.
#[derive(Debug, Default)]
pub(crate) struct Status(Mutex<Seen>);

#[derive(Debug, Default, Clone)]
enum Seen {
    #[default]
    Nothing,
    Answered,
    Failed(String),
    Connected,
}

impl Status {
    /// The agent has sent something, and the handshake is not over.
    pub(crate) fn answered(&self) {
        let mut seen = self.seen();
        if matches!(*seen, Seen::Nothing) {
            *seen = Seen::Answered;
        }
    }

    pub(crate) fn failed(&self, why: String) {
        *self.seen() = Seen::Failed(why);
    }

    pub(crate) fn connected(&self) {
        *self.seen() = Seen::Connected;
    }

    /// The reason why the handshake did not end well, if the agent took part in it.
    pub(crate) fn failure(&self, unfinished: &str) -> Option<String> {
        match self.seen().clone() {
            Seen::Nothing | Seen::Connected => None,
            Seen::Answered => Some(unfinished.to_owned()),
            Seen::Failed(why) => Some(why),
        }
    }

    fn seen(&self) -> std::sync::MutexGuard<'_, Seen> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
