//! `replenish agent`: the agent alone, and what it is doing.
//!
//! ```text
//!   at the start  options, policy, dds; access, secure ─► private
//!   as it runs    watch ─► view ─► status ─► bridge_rows ─► log
//!                   ├► access: read again
//!                   └► console; boards: what clients send of themselves
//! ```

mod access;
mod boards;
mod bridge_rows;
mod console;
mod dds;
mod log;
mod options;
mod policy;
mod private;
#[cfg_attr(not(feature = "secure"), path = "secure_disabled.rs")]
mod secure;
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
use access::AccessFile;
use console::Console;
use replenish_agent::{AccessList, Agent, AgentConfig, AgentError, MemoryBound, Stats, StopHandle};
use replenish_os::{Policy, Thread, ThreadSpec, spawn};
use std::path::PathBuf;
use watch::Watcher;

/// Its priority under an orchestrator, so that a busy machine does not hold up messages.
const SUPPORT_PRIORITY: u8 = 70;

/// Name of the agent's thread.
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

    /// The clients that may log in, from where, and the topics that each may write and read: a
    /// TOML file with a table [[client]] for each (docs/agent.md). SIGHUP reads it again. Without
    /// it every client may do everything.
    #[arg(long, value_name = "FILE")]
    access: Option<PathBuf>,

    #[command(flatten)]
    encrypted: secure::Ports,

    #[command(flatten)]
    bridge: dds::Bridge,

    /// The scheduling policy of its thread: other, fifo:PRIORITY or rr:PRIORITY, 1 to 99. Without
    /// it the one that this command was started with, as by chrt.
    #[arg(long, value_name = "POLICY", value_parser = policy::parse)]
    policy: Option<Policy>,

    /// The CPU of its thread.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// Show clients, topics and endpoints with their rates as a table, every so many seconds (1 if
    /// not said). Without it SIGUSR1 asks for one.
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "1",
          value_parser = clap::value_parser!(u64).range(1..=3600))]
    watch: Option<u64>,

    /// Write the state to this file as JSON: with every table, and at the end. A reader never finds
    /// half of it.
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
    // Before there are other threads: they inherit the ordinary policy.
    let inherited = policy::take_over()?;
    files::check_writable(args.json.as_deref())?;
    let stop = if args.access.is_some() {
        Stop::on_signals_questions_and_reloads()?
    } else {
        Stop::on_signals_and_questions()?
    };
    let config = options::config(&args.transports, &args.bounds, &args.service)?;
    let config = args.encrypted.add_to(config, args.transports.has_udp())?;
    let mut config = args.bridge.add_to(config);
    config.access = args.access.as_deref().map(access::read).transpose()?;
    let agent = Agent::bind(&config).map_err(Failure::refused)?;
    let entries = config.access.as_ref().map_or(0, AccessList::len);
    let access = args.access.clone();
    let access = access.map(|path| AccessFile::new(path, agent.access_control(), entries));
    let address = agent.local_addr();
    let places = places(&agent, &config);
    // Under the orchestrator it must not wait for other programs of a busy machine.
    let policy = match args.policy {
        Some(policy) => policy,
        None if args.supervised && !args.ordinary => fifo_or_other(SUPPORT_PRIORITY),
        None if args.supervised => Policy::Other,
        None => inherited,
    };
    let watcher = Watcher {
        output: Console::output(),
        error: Console::error(),
        policy: policy.to_string(),
        inspector: agent.inspector(),
        address: address.to_string(),
        addresses: places.clone(),
        limits: config.limits,
        bound: MemoryBound::of(&config),
        access,
        every: args.watch.map(|seconds| seconds * SEC),
        json: args.json.clone(),
        quiet: args.supervised,
        bridged: args.bridge.is_on(),
    };
    watcher.warn_of_strangers(&agent);
    let inspector = agent.inspector();
    let error = (!args.supervised).then(Console::error);
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
        watcher.announce(&places, &policy);
    }
    let say = move |text: &str| {
        if let Some(error) = &error {
            error.write(format!("agent: {text}\n"));
        }
    };
    let boards = boards::watch(inspector, address.to_string(), say);
    let seen = watcher.watch(&stop);
    drop(boards); // while the agent still answers
    handle.stop();
    let stats = thread
        .join()
        .map_err(|_| Failure::refused("the agent's thread panicked"))?
        .map_err(Failure::refused)?;
    seen.finish(&stats)
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
    let encrypted = secure::places(agent);
    udp.chain(tcp).chain(encrypted).chain(serial).collect()
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
