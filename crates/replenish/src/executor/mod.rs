//! The executor: workers, each a thread with a policy, behind one dispatcher.
//!
//! ```text
//!   middleware ──► dispatcher ──► inbox ──► worker: decode, callback   (one thread, one policy)
//!       ▲                                     │
//!       └────────────── publish ──────────────┘      enforcers hold the budgets from below
//! ```
//!
//! The rooms, each above the ones it imports:
//!
//! ```text
//!   start     from a description to threads: plan, admission, start, the executor that runs
//!   change    handles that come and go while it runs
//!   describe  the executor, its workers and their handles as the program describes them
//!   run       the two loops: dispatcher and worker
//!   handles   subscription, timer, guard condition, service, client, and their callbacks
//!   wake      when a worker wakes, and which handles it looks at
//!   models    every interleaving of their protocols (`--cfg loom` alone)
//! ```
//!
//! Two ways through the files, for a reader:
//!
//! ```text
//!   a sample  udp · adapter · state · objects (middleware/xrce, with incoming of replenish-xrce)
//!             run/dispatcher · run/routes · inbox and doorbell of replenish-handoff
//!             run/worker · handles/entry · handles/subscription · handles/handle: the callback
//!   a budget  describe/builder · start/launch · start/plan · start/threads
//!             enforcer · account · budgeted · state of replenish-os's enforcer · linux/timer
//! ```

#[cfg_attr(not(feature = "full"), path = "change_disabled.rs")]
mod change;
mod describe;
mod handles;
#[cfg(all(test, loom))]
mod models;
mod run;
mod start;
pub(crate) mod wake;

#[allow(unused_imports, reason = "for diagnostics, which need feature `std`")]
pub(crate) use change::live::Live;
#[cfg(feature = "full")]
pub use change::{ExecutorHandle, HandleId, Removal, WorkerHandle};
pub use describe::add::AddHandles;
pub(crate) use describe::add::{Numbering, Target};
pub use describe::builder::WorkerBuilder;
pub use describe::executor::Executor;
pub use describe::factory::RawType;
pub use describe::planning::AdmissionReport;
pub use describe::topic::Topic;
pub use handles::callback::{CallbackContext, CallbackResult};
pub use handles::deadline::{DeadlineMiss, OnMiss};
#[allow(unused_imports, reason = "for chains, which need feature `std`")]
pub(crate) use handles::entry::HandleEntry;
pub use handles::group::Group;
pub use handles::guard::GuardCondition;
pub(crate) use handles::one_user::OneUser;
pub use handles::options::HandleOptions;
#[allow(unused_imports, reason = "for diagnostics, which need feature `std`")]
pub(crate) use handles::state::HandleState;
pub use handles::timer::TimerHandle;
pub use run::guarantee::AdoptedReport;
pub use run::round_stats::{RoundReport, RoundStats};
pub use run::rules::{HandleStates, Semantics, Trigger};
#[allow(unused_imports, reason = "for chains, which need feature `std`")]
pub(crate) use run::state::WorkerSpec;
pub use start::local::{LocalExecutor, SpinEnd, SpinResult};
pub use start::report::{DispatcherReport, HandleReport, Report, ThreadReport};
pub use start::running::RunningExecutor;
#[allow(unused_imports, reason = "for diagnostics, which need feature `std`")]
pub(crate) use start::threads::ThreadPlan;
pub(crate) use wake::schedule::nanos;
pub use wake::schedule::{Every, Overrun};
pub use wake::stop::StopHandle;
