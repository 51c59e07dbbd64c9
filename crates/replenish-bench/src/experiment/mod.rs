//! `replenish experiment …`: the paper's experiments and its open question, and what budgets
//! protect.
//!
//! ```text
//!   command ─► budget_sweep ────► sweep_report ─┬─► deviation    simulated against measured
//!           ─► work_conserving ─► sleep_report ─┘
//!           ─► nuttx_history ───► history_figure ─► history_row
//!           ─► isolation
//!   output   files and remarks, of all four
//! ```

mod budget_sweep;
mod command;
mod deviation;
mod history_figure;
mod history_row;
mod isolation;
mod nuttx_history;
mod output;
mod sleep_report;
mod sweep_report;
mod work_conserving;

pub(crate) use command::{Experiment, run};
