//! Guarantees, in builds without feature `plan`: there are none.

use core::fmt;
use sporadic::Budget;

/// There are no guarantees.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Guarantee {}

impl Guarantee {
    pub(crate) const fn budget(&self) -> Budget {
        match *self {}
    }
}

impl fmt::Display for Guarantee {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

/// No threads are adopted in builds without feature `plan`.
#[derive(Debug, Clone, Copy)]
pub enum AdoptedReport {}
