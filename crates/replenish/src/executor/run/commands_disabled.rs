//! In the place of `commands` in builds without feature `full`: there are no commands.

use super::accounting::CpuAccounting;
use super::mailbox::Command;
use super::state::Worker;
use replenish_os::Account;

impl Worker {
    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn apply(&self, command: Command, _: &mut Account, _: &CpuAccounting) {
        match command {}
    }
}
