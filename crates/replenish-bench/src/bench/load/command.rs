//! One run of `bench load`.

use super::agent::AgentProcess;
use super::generator::{self, Load, Tally};
use super::options::Args;
use super::report;
use crate::load::SEC;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::signals::Stop;

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    files::check_writable(args.json.json.as_deref())?;
    let stop = Stop::on_signals()?;
    let load = Load {
        clients: args.clients,
        topics: args.topics,
        period: SEC / args.rate,
        samples: args.rate * args.seconds,
        bytes: usize::try_from(args.bytes).unwrap_or(32),
    };
    let mut agent = AgentProcess::start(args.clients, args.topics)?;
    let measured = generator::run(&load, args.threads, agent.address(), &stop, |at| {
        agent.sample(at);
    });
    let agent = agent.end()?;
    let tally: Tally = measured?;
    if stop.is_triggered() {
        return Err(Failure::refused("stopped before its end"));
    }
    let json = report::json(args, &load, &tally, &agent);
    report::print(&json);
    files::write_json(args.json.json.as_deref(), "bench-load", &json)?;
    report::verdict(&json)
}
