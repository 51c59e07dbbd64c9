//! The kernel leaves locked pages where they are while the torture runs.
//!
//! It moves them to make room for large ones, and an enforcer that needs such a page waits for the
//! thread that moves it, at no real-time priority: docs/enforcement.md, *Memory*, has the setting
//! among the assumptions. Seed 7 had an enforcer wait for 25 ms beside compilers.

use std::fs;

const SETTING: &str = "/proc/sys/vm/compact_unevictable_allowed";

/// Gives the host its setting back when it is dropped.
pub(super) struct LockedPages {
    before: Option<String>,
}

impl LockedPages {
    /// Switches the moving off. Nothing happens where the kernel has no such setting, or refuses
    /// the change.
    pub(super) fn stay() -> Self {
        let before = fs::read_to_string(SETTING).ok();
        let before = before.filter(|_| fs::write(SETTING, "0").is_ok());
        Self { before }
    }
}

impl Drop for LockedPages {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            fs::write(SETTING, before).ok(); // it could be written before
        }
    }
}
