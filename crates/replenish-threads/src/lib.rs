//! CPU budgets for threads of this process that another executor runs.
//!
//! ```text
//!   libreplenish, replenish-rclrs
//!              ▼
//!           budgets ─ the budgets of this process: made, joined, left, read, ended
//!              ├─► admission ─ does it fit, beside everything that was promised on this host?
//!              │        └────► overlay ─ the deployment file's word about a name
//!              └─► replenish_os::foreign ─ enforcers, one for each CPU with budgets
//!   marks ─ points of the program in a recording, which `replenish trace` reads
//!   asked ─ a budget as the program asks for it     failure ─ an answer that is no budget
//! ```
//!
//! Budgets are known by numbers, because C programs hold them. Linux only.

mod admission;
mod asked;
mod budgets;
mod failure;
mod marks;
mod overlay;

pub use admission::ENFORCER;
pub use asked::Asked;
pub use budgets::{Report, attach, check, detach, list, new, release, report};
pub use failure::{Failure, Why};
pub use marks::{mark, new_mark};
pub use replenish_os::foreign::BudgetUsage;
pub use replenish_os::{Level, SchedClass, Tid, current_tid};
pub use replenish_plan::{Guarantee, Requirement};
pub use sporadic::{Budget, Low, Nanos, Params, Policy};
