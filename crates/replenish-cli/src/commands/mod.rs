//! The command line: one module per command.

mod agent;
mod bench_dispatch;
mod bench_enforcement;
mod bench_handoff;
mod bench_load;
mod bench_round_trip;
mod bench_xrce;
mod demo;
mod demo_report;
mod doctor;
mod experiment;
mod host;
mod latency;
mod overheads;
mod ping;
mod plan;
mod pong;
mod simulate;
mod suggest;

use crate::outcome::Outcome;
use clap::{Parser, Subcommand};

/// A ROS executor that gives every callback a CPU budget: see it, measure it, run it.
#[derive(Debug, Parser)]
#[command(name = "replenish", version, arg_required_else_help = true)]
#[command(after_help = "Start with: replenish demo\n\
    Exit codes: 0 done, 1 could not be done (the reason is printed), 2 wrong command line.")]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Two topics fight over one CPU; a budget decides. Ten seconds, then a table and a report
    Demo(demo::Args),
    /// The experiments of the paper, with the theoretical line beside the measured one
    #[command(subcommand)]
    Experiment(Experiment),
    /// Does a deployment file fit on its machine? The plan with its worst cases, or the reason why not
    Plan(plan::Args),
    /// Run a deployment file in virtual time and draw its schedule
    Simulate(simulate::Args),
    /// Propose budgets for a program from what its threads take while it runs
    Suggest(suggest::Args),
    /// What this machine grants to real-time threads, with advice
    Doctor(doctor::Args),
    /// Figures of the mechanisms next to a baseline measured in the same run
    #[command(subcommand)]
    Bench(Bench),
    /// The agent alone: what ping and pong talk through
    Agent(agent::Args),
    /// Ping alone: sends on two topics and counts the answers
    Ping(ping::Args),
    /// Pong alone: answers, its workers under their scheduling policies
    Pong(pong::Args),
}

#[derive(Debug, Subcommand)]
enum Experiment {
    /// Experiment 1: answers over the budget, and both workers under plain FIFO
    BudgetSweep(experiment::budget_sweep::Args),
    /// Experiment 2: the low worker sleeps; the high one uses what is left in the background
    WorkConserving(experiment::work_conserving::Args),
    /// What a neighbour, a runaway callback and a flood do to a control loop, without and with budgets
    Isolation(experiment::isolation::Args),
    /// The paper's open question: its measurements on NuttX, replayed with and without two bugs
    NuttxHistory(experiment::nuttx_history::Args),
}

#[derive(Debug, Subcommand)]
enum Bench {
    /// How far budgets are overrun, against a POSIX CPU timer
    Enforcement(bench_enforcement::Args),
    /// Waking a worker, against a bare futex
    Handoff(bench_handoff::Args),
    /// The reliable streams over links that lose datagrams, in virtual time
    Xrce(bench_xrce::Args),
    /// Client to agent to client, against a raw UDP echo
    RoundTrip(bench_round_trip::Args),
    /// Many clients with many topics on real sockets, through one agent process
    Load(bench_load::Args),
    /// What it costs to bring a message to its callback, for one handle and for a thousand
    Dispatch(bench_dispatch::Args),
}

impl Cli {
    /// Runs the command.
    pub(crate) fn run(self) -> Outcome {
        match self.command {
            Command::Demo(args) => demo::run(&args),
            Command::Experiment(Experiment::BudgetSweep(args)) => {
                experiment::budget_sweep::run(&args)
            }
            Command::Experiment(Experiment::WorkConserving(args)) => {
                experiment::work_conserving::run(&args)
            }
            Command::Experiment(Experiment::Isolation(args)) => experiment::isolation::run(&args),
            Command::Experiment(Experiment::NuttxHistory(args)) => {
                experiment::nuttx_history::run(&args)
            }
            Command::Plan(args) => plan::run(&args),
            Command::Simulate(args) => simulate::run(&args),
            Command::Suggest(args) => suggest::run(&args),
            Command::Doctor(args) => doctor::run(&args),
            Command::Bench(Bench::Enforcement(args)) => bench_enforcement::run(&args),
            Command::Bench(Bench::Handoff(args)) => bench_handoff::run(&args),
            Command::Bench(Bench::Xrce(args)) => bench_xrce::run(&args),
            Command::Bench(Bench::RoundTrip(args)) => bench_round_trip::run(&args),
            Command::Bench(Bench::Load(args)) => bench_load::run(&args),
            Command::Bench(Bench::Dispatch(args)) => bench_dispatch::run(&args),
            Command::Agent(args) => agent::run(&args),
            Command::Ping(args) => ping::run(&args),
            Command::Pong(args) => pong::run(&args),
        }
    }
}
