//! `replenish agent`: the agent alone, and what it is doing.

#[cfg_attr(not(feature = "dds"), path = "dds_disabled.rs")]
mod dds;
mod log;
mod options;
mod status;
mod view;
mod watch;

use crate::machine::cpus;
use crate::machine::fifo_or_other;
use crate::outcome::{Failure, Outcome};
use crate::report::files;
use crate::signals::Stop;
use crate::supervised::{self, Event, Ready};
use crate::threads;
use crate::time::SEC;
use replenish_agent::{Agent, AgentConfig, AgentError, Stats, StopHandle};
use replenish_os::{Policy, Thread, ThreadSpec, spawn};
use std::io::Write;
use std::path::PathBuf;
use watch::Watcher;

/// Its priority under an orchestrator, so that a busy machine does not hold up messages.
const SUPPORT_PRIORITY: u8 = 70;

/// How the agent's thread is called.
const THREAD: &str = "xrce-agent";

/// Options of `agent`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    transports: options::Transports,

    #[command(flatten)]
    bounds: options::Bounds,

    #[command(flatten)]
    service: options::Service,

    #[command(flatten)]
    bridge: dds::Bridge,

    /// The CPU of its thread
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// Show clients, topics and endpoints with their rates as a table, every so many seconds (1 if
    /// not said). Without it SIGUSR1 asks for one
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "1",
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    watch: Option<u64>,

    /// Write the state to this file as JSON: with every table, and at the end. A reader never finds
    /// half of it
    #[arg(long, value_name = "PATH")]
    json: Option<PathBuf>,

    #[arg(long, hide = true)]
    supervised: bool,

    /// Under the ordinary policy although supervised.
    #[arg(long, hide = true)]
    ordinary: bool,
}

/// Runs the agent until a signal.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.as_deref())?;
    let stop = Stop::on_signals_and_questions()?;
    let config = options::config(&args.transports, &args.bounds, &args.service)?;
    let config = args.bridge.add_to(config)?;
    let agent = Agent::bind(&config).map_err(Failure::refused)?;
    let address = agent.local_addr();
    let places = places(&agent, &config);
    let watcher = Watcher {
        inspector: agent.inspector(),
        address: address.to_string(),
        addresses: places.clone(),
        limits: config.limits,
        every: args.watch.map(|seconds| seconds * SEC),
        json: args.json.clone(),
        quiet: args.supervised,
    };
    warn_of_strangers(&agent);
    // Under the orchestrator it must not wait for other programs of a busy machine.
    let policy = if args.supervised && !args.ordinary {
        fifo_or_other(SUPPORT_PRIORITY)
    } else {
        Policy::Other
    };
    let handle = StopHandle::new();
    let thread = start(agent, policy, args.cpu, handle.clone(), stop.clone())?;
    if args.supervised {
        supervised::listen(stop.clone(), |_| ());
        let row = threads::row("agent", THREAD, &policy);
        let address = Some(address.to_string());
        supervised::emit(&Event::Ready(Ready {
            address,
            mode: None,
            threads: vec![row],
        }));
    } else {
        println!(
            "agent listening at {}; end it with SIGINT or SIGTERM",
            places.join(", ")
        );
    }
    let seen = watcher.watch(&stop);
    handle.stop();
    let stats = thread
        .join()
        .map_err(|_| Failure::refused("the agent's thread panicked"))?
        .map_err(Failure::refused)?;
    let outcome = seen.finish(&stats);
    if !args.supervised {
        // Whoever has read this may be gone already.
        writeln!(
            std::io::stdout(),
            "{} sessions; {} samples in, {} out, {} dropped for want of room",
            stats.clients_created,
            stats.samples_in,
            stats.samples_out,
            stats.samples_dropped + stats.samples_refused
        )
        .ok();
    }
    outcome
}

/// Everything it listens at, for people.
fn places(agent: &Agent, config: &AgentConfig) -> Vec<String> {
    let udp = agent
        .udp_addrs()
        .into_iter()
        .map(|at| format!("{at} (UDP)"));
    let tcp = agent.tcp_addr().map(|at| format!("{at} (TCP)"));
    let serial = config
        .serial
        .iter()
        .map(|line| format!("{} ({} baud)", line.path.display(), line.baud));
    udp.chain(tcp).chain(serial).collect()
}

/// Says so when other hosts can reach it.
fn warn_of_strangers(agent: &Agent) {
    let addresses = agent.udp_addrs().into_iter().chain(agent.tcp_addr());
    for address in addresses.filter(|address| !address.ip().is_loopback()) {
        eprintln!(
            "note: {address} can be reached from other hosts, and XRCE knows no authentication: \
             whoever reaches it can read and write every topic"
        );
    }
}

/// The agent on a thread of its own; a socket that fails ends the command.
fn start(
    mut agent: Agent,
    policy: Policy,
    cpu: Option<usize>,
    handle: StopHandle,
    stop: Stop,
) -> Result<Thread<Result<Stats, AgentError>>, Failure> {
    let spec = ThreadSpec::new(THREAD).policy(policy).cpu(cpu);
    let body = move || {
        let outcome = agent.run(&handle);
        stop.trigger();
        outcome.map(|()| agent.stats())
    };
    spawn(spec, body).map_err(Failure::refused)
}
