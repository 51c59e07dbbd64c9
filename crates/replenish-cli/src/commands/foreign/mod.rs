//! Budgets for programs of others: what `replenish run` and `replenish adopt` share.
//!
//! ```text
//!   run, adopt ─► supervisor ─ looks for threads, gives them budgets
//!                   │  │  │└─► budgets ─► rules   which thread gets which budget
//!                   │  │  └──► figures ─► report  tables and JSON
//!                   │  └─────► control  a socket: --list, --release
//!                   ▼
//!                 guardian ─ another process: gives everything back if this one is killed
//!                   └──► give_back ◄── supervisor
//!   cgroup ─ control groups in which threads are stopped
//!   options ─ what both can be told ─► selection ─ or a `[[program]]` of a deployment file
//!                                        └─► admission ─ beside what the ledger has ─► budgets
//! ```

mod admission;
mod budgets;
mod cgroup;
pub(super) mod control;
mod figures;
mod give_back;
pub(super) mod guardian;
pub(super) mod options;
pub(super) mod report;
pub(super) mod rules;
pub(super) mod selection;
pub(super) mod supervisor;
