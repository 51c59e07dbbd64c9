//! In the place of `recorded.rs` on a board: the account of a task whose budget is recorded.

use super::account::Account;
use crate::recorder;

impl Account {
    /// The events of its budget are those of this task of the [`recorder`] from now on; 0: of
    /// none. Set-up only.
    pub fn record_as(&self, task: u8) {
        if recorder::ON
            && let Some(budget) = &self.meter().0.budget
        {
            budget.with(|thread| thread.supervised.record_as(task));
        }
    }
}
