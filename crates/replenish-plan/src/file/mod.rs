//! `replenish.toml`: what runs on a machine and what it needs.
//!
//! One file for three readers. The planner takes guarantees and policies from it, the executor
//! scheduling by stable handle ids, the simulator releases and execution times. Unknown keys,
//! unknown names and values that contradict each other are errors with line and column.
//!
//! ```toml
//! [machine]
//! cpus = 2                     # or a list: [1, 3]
//!
//! [[worker]]
//! name = "control"
//! handles = ["control/timer:0"]
//! guarantee = { rate = "100 Hz", takes = "2 ms", deadline = "5 ms" }
//! runs = { min = "1 ms", max = "2 ms" }
//!
//! [[worker]]
//! name = "map"
//! handles = ["/map/sub:/scan"]
//! guarantee = { budget = "30 ms", period = "100 ms", desired = "60 ms" }
//! releases = { every = "100 ms", jitter = "5 ms" }
//! runs = "25 ms"
//!
//! [[program]]                  # of somebody else: `replenish run`, `replenish adopt`
//! name = "planner"
//! match = "python3 planner.py*"
//! [[program.thread]]
//! match = "dds.*"
//! guarantee = { budget = "2 ms", period = "10 ms" }
//! ```
//!
//! `docs/guarantees.md` has every key.

mod chain;
mod deployment;
mod error;
mod parse;
mod program;
mod programs;
mod scheduling;
mod schema;
mod system;
mod template;

pub use deployment::{Chain, Deployment, Described, Load};
pub use error::FileError;
pub use parse::{MAX_FILE, MAX_WORKERS};
pub use program::{Program, ProgramThread};
pub use template::{Template, TemplateWorker};
