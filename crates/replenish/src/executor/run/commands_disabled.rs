//! In the place of `commands` in builds without feature `full`: there are no commands.

use super::mailbox::Command;
use super::state::Worker;

impl Worker {
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn apply(&self, command: Command) {
        match command {}
    }
}
