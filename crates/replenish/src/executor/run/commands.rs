//! A worker carries out commands from its mailbox. In builds without feature `full` there are none:
//! `commands_disabled.rs` takes this file's place.

use super::accounting::CpuAccounting;
use super::mailbox::Command;
use super::rounds::BY_RULES;
use super::state::Worker;
use crate::executor::handles::entry::HandleEntry;
use crate::sync::Arc;
use alloc::vec::Vec;
use replenish_os::{Account, clock};

impl Worker {
    /// Takes a handle over, lets go of one, or begins rounds by another trigger.
    pub(super) fn apply(
        &mut self,
        command: Command,
        account: &mut Account,
        accounting: &CpuAccounting,
    ) {
        match command {
            Command::Add(mut entry) => {
                let wake = self.mailbox.wake_handle(entry.slot);
                entry.begin(clock::monotonic(), &wake);
                if entry.handling.always {
                    self.spec.rules.rounds.get_or_insert(&BY_RULES);
                }
                insert(&mut self.spec.entries, entry);
                self.reordered();
            }
            Command::Remove(handle) => {
                let mut entries = self.spec.entries.iter();
                let at = entries.position(|e| Arc::ptr_eq(&e.shared, &handle));
                if let Some(at) = at {
                    let mut entry = self.spec.entries.remove(at);
                    self.reordered();
                    self.empty(&mut entry, account, accounting);
                    self.mailbox.retire(entry);
                }
                handle.departure.gone.set();
            }
            Command::Trigger(swap) => {
                swap.swap(&mut self.spec.rules.trigger);
                self.spec.rules.rounds.get_or_insert(&BY_RULES);
                self.reordered();
            }
        }
    }
}

/// Inserts behind the entries of the same or a higher priority.
fn insert(entries: &mut Vec<HandleEntry>, entry: HandleEntry) {
    let priority = entry.handling.priority;
    let mut others = entries.iter();
    let at = others.position(|e| e.handling.priority < priority);
    entries.insert(at.unwrap_or(entries.len()), entry);
}
