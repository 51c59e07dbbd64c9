//! `replenish experiment …`: which experiment.

use super::{budget_sweep, isolation, nuttx_history, work_conserving};
use replenish_cli::outcome::Outcome;

/// An experiment with its options.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Experiment {
    /// Experiment 1: answers over the budget, and both workers under plain FIFO.
    BudgetSweep(budget_sweep::Args),
    /// Experiment 2: the low worker sleeps; the high one uses what is left in the background.
    WorkConserving(work_conserving::Args),
    /// A control loop beside a neighbour, a runaway callback and a flood, without and with budgets.
    Isolation(isolation::Args),
    /// The paper's open question: its measurements on NuttX, replayed with and without two bugs.
    NuttxHistory(nuttx_history::Args),
}

/// Runs it.
pub(crate) fn run(which: Experiment) -> Outcome {
    match which {
        Experiment::BudgetSweep(args) => budget_sweep::run(&args),
        Experiment::WorkConserving(args) => work_conserving::run(&args),
        Experiment::Isolation(args) => isolation::run(&args),
        Experiment::NuttxHistory(args) => nuttx_history::run(&args),
    }
}
