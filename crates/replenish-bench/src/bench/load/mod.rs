//! `replenish bench load`: many clients with many topics on real sockets, through one agent process.
//!
//! Client `i` writes its topics at the given rate and reads those of client `i - 1`, all reliable.
//! Every sample carries its number and the time at which it was due: the generator counts each
//! topic's samples as they come, so a lost, repeated or overtaken one shows, and latency includes
//! what a sample waited because the stream was full or the generator late.
//!
//! ```text
//!   generator threads (few), 64 sockets ──► agent process ──► the same sockets
//! ```

mod agent;
mod generator;
mod report;

use crate::load::SEC;
use agent::AgentProcess;
use generator::{Load, Tally};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::signals::Stop;

/// Options of `bench load`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Clients
    #[arg(long, value_name = "N", default_value_t = 64,
          value_parser = clap::value_parser!(u16).range(2..=256))]
    clients: u16,

    /// Topics that each client writes, and reads
    #[arg(long, value_name = "N", default_value_t = 8,
          value_parser = clap::value_parser!(u16).range(1..=32))]
    topics: u16,

    /// Samples a second on each topic
    #[arg(long, value_name = "HZ", default_value_t = 100,
          value_parser = clap::value_parser!(u64).range(1..=1000))]
    rate: u64,

    /// How long
    #[arg(long, value_name = "N", default_value_t = 60,
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    seconds: u64,

    /// Bytes of a sample
    #[arg(long, value_name = "BYTES", default_value_t = 32,
          value_parser = clap::value_parser!(u64).range(16..=400))]
    bytes: u64,

    /// Threads that are the clients
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=16))]
    threads: u16,

    #[command(flatten)]
    json: JsonOption,
}

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
    files::write_json(args.json.json.as_deref(), &json)?;
    report::verdict(&json)
}
