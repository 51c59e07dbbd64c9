//! The planner: from a request to a plan that holds, or a refusal.
//!
//! ```text
//!  Request ─► problem: what can be chosen, what cannot        (placement: one thread of either)
//!                 ├── locks: who waits for whom, and for how long
//!                 │ minimum amounts
//!  planning       ▼
//!             assign: CPUs ──► cpu: priorities, tasks, bounds ──► does every deadline hold?
//!                 │ yes                                               │ no
//!                 ▼                                                   ▼
//!             elastic: more, by importance (search)               refusal: who, why, beside whom
//!                 ▼                                                   ▼
//!             describe: a plan, with its rationale                alternatives: what would fit
//! ```

mod alternatives;
mod assign;
mod cpu;
mod describe;
mod elastic;
pub(crate) mod locks;
mod neighbours;
mod placement;
mod plan;
mod planning;
mod priorities;
mod problem;
mod rationale;
mod refusal;
mod search;
mod tasks;

pub use alternatives::{Alternative, Changed};
pub use plan::{CpuLoad, Plan, PlannedChain, PlannedExecutor, PlannedWorker};
pub use planning::plan;
pub use refusal::Refusal;
