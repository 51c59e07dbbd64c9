//! `replenish bench foreign …`: which measurement.

use super::options::Options;
use super::{cost, flood, shares, trips};
use replenish_cli::outcome::Outcome;

/// A measurement with its options.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Foreign {
    /// Two programs, C and Python, on one CPU: 30 ms in every 100 and the rest.
    Shares(Options),
    /// Round trips of genuine rclpy programs beside one whose callback never returns.
    Trips(trips::Args),
    /// A control loop beside middleware threads that get 50 000 messages a second.
    Flood(Options),
    /// The enforcer's CPU time per foreign thread, next to one of ours.
    Cost(Options),
}

/// Runs it.
pub(crate) fn run(which: &Foreign) -> Outcome {
    match which {
        Foreign::Shares(options) => shares::run(options),
        Foreign::Trips(args) => trips::run(args),
        Foreign::Flood(options) => flood::run(options),
        Foreign::Cost(options) => cost::run(options),
    }
}
