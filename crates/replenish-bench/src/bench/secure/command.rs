//! One run of `bench secure`.

use super::super::agent_cpus::AgentCpus;
use super::credentials::Credentials;
use super::measure::measure;
use super::path::Place;
use super::report::Json;
use crate::load::spec::SUPPORT_PRIORITY;
use replenish_agent::{Agent, StopHandle};
use replenish_cli::lock;
use replenish_cli::machine::fifo_or_other;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_os::clock::ThreadCpuClock;
use replenish_os::{ThreadSpec, spawn};

/// Options of `bench secure`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Round trips on each path, of each size.
    #[arg(long, value_name = "N", default_value_t = 10_000,
          value_parser = clap::value_parser!(u64).range(200..=1_000_000))]
    samples: u64,

    #[command(flatten)]
    cpus: AgentCpus,

    #[command(flatten)]
    json: JsonOption,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    let (client_cpu, agent_cpu) = args.cpus.chosen()?;
    files::check_writable(args.json.json.as_deref())?;
    let _alone = lock::acquire()?;

    let credentials = Credentials::make()?;
    let mut agent = Agent::bind(&credentials.agent()?).map_err(Failure::refused)?;
    let place = Place::of(&agent)?;
    let policy = fifo_or_other(SUPPORT_PRIORITY);
    let stop = StopHandle::new();
    let stopped = stop.clone();
    let spec = ThreadSpec::new("xrce-agent").policy(policy).cpu(agent_cpu);
    let agent = spawn(spec, move || agent.run(&stopped).map_err(Failure::refused));
    let agent = agent.map_err(Failure::refused)?;

    let clock = ThreadCpuClock::of(agent.tid());
    let samples = usize::try_from(args.samples).unwrap_or(usize::MAX);
    let spec = ThreadSpec::new("client").policy(policy).cpu(client_cpu);
    let client = spawn(spec, move || {
        measure(place.connect(&credentials)?, clock, samples)
    });
    let measured = client.map_err(Failure::refused)?.join();
    stop.stop();
    let ended = agent.join();
    ended.map_err(|_| Failure::refused("the agent's thread panicked"))??;
    let measured = measured.map_err(|_| Failure::refused("the client's thread panicked"))??;

    let json = Json::new(measured, client_cpu, agent_cpu);
    json.print();
    files::write_json(args.json.json.as_deref(), "bench-secure", &json)?;
    json.check()
}
