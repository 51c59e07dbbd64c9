//! Plans what programs need: a schedule that gives it to them, or a refusal with its reason.
//!
//! ```text
//!   guarantees ─┐
//!   policies   ─┼─► Request ──► plan ──┬─► Plan: CPU, priority, budget, bounds, reasons
//!   replenish.toml ┘     ▲             └─► Refusal: one sentence, and what would fit
//!                 ledger: what other programs on this host have been promised
//! ```
//!
//! - [`Guarantee`]: what a worker needs, in its user's words.
//! - [`Machine`], [`Overheads`]: what there is to give, and what enforcing costs.
//! - [`plan`]: pure; the same request gives the same plan. Bounds come from
//!   [`replenish_sim::analysis`].
//! - [`Deployment`]: `replenish.toml`, which is also the simulator's input.
//! - [`ledger`]: what programs on this host have reserved; the only part with I/O.
//!
//! ```
//! use replenish_plan::{Guarantee, Machine, Request, Worker, plan};
//! use std::time::Duration;
//!
//! let ms = Duration::from_millis;
//! let request = Request::new(Machine::with_cpus(1))
//!     .worker(Worker::guaranteed("control", Guarantee::of(ms(3)).every(ms(10))))
//!     .worker(Worker::guaranteed("camera", Guarantee::of(ms(50)).every(ms(100))));
//! let plan = plan(&request)?;
//! assert!(plan.workers[0].priority() > plan.workers[1].priority());
//!
//! let more = request.worker(Worker::guaranteed("map", Guarantee::of(ms(30)).every(ms(100))));
//! let refusal = replenish_plan::plan(&more).unwrap_err();
//! assert!(refusal.to_string().contains("would fit"), "{refusal}");
//! # Ok::<(), replenish_plan::Refusal>(())
//! ```
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod file;
mod guarantee;
mod guarantee_error;
#[cfg(unix)]
pub mod ledger;
mod machine;
mod planner;
mod request;
pub mod span;

pub use file::{Deployment, FileError, Template, TemplateWorker};
pub use guarantee::{Guarantee, OfAmount, OfRate};
pub use guarantee_error::GuaranteeError;
pub use machine::{Machine, Overheads};
pub use planner::{
    Alternative, Changed, CpuLoad, Plan, PlannedChain, PlannedExecutor, PlannedWorker, Refusal,
    plan,
};
pub use replenish_sim::analysis::{Demand, Section};
pub use request::{ExecutorRequest, Hold, Promise, Request, Requirement, Worker};
pub use sporadic::{Nanos, Policy};
