//! An account whose budget is recorded.

use super::account::Account;
use super::budget_record::BudgetRecord;

impl Account {
    /// Records the account and the events of its budget from now on; without a budget it records
    /// nothing. Set-up only.
    pub fn record(&self, record: BudgetRecord) {
        if let Some(budget) = &self.meter().0.budget {
            budget.with(|thread| thread.supervised.record_to(record));
        }
    }

    /// On a board, the number of the task of the [`recorder`](crate::recorder). A host records no
    /// task by a number: nothing happens.
    pub fn record_as(&self, _: u8) {}
}
