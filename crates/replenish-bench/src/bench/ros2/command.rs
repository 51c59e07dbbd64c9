//! Options and one run of `bench ros2`.

use super::part::{self, Role};
use super::path::Path;
use super::report::{Json, points};
use super::windows::{Plan, measure};
use super::{encoding, flood, fragments};
use crate::bench::in_process::{Setting, in_process};
use crate::load::spec::SUPPORT_PRIORITY;
use replenish_cli::lock;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_os::ThreadSpec;

/// Options of `bench ros2`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Paths to compare.
    #[arg(
        long,
        value_name = "PATH,…",
        value_delimiter = ',',
        default_value = "raw-udp,wire,executor,executor-udp,cyclone,rcl-fastdds"
    )]
    paths: Vec<Path>,

    /// Bytes of a sample. From 512 kB on 100 a second, else 1000.
    #[arg(long, value_name = "BYTES,…", value_delimiter = ',', default_value = "64,1024,65536,1048576",
          value_parser = clap::value_parser!(u64).range(64..=1_048_576))]
    bytes: Vec<u64>,

    /// Windows of 0.4 s of each path and size.
    #[arg(long, value_name = "N", default_value_t = 5,
          value_parser = clap::value_parser!(u64).range(1..=1000))]
    windows: u64,

    /// The CPU of all of them.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// ROS domains that nobody uses, one for each path.
    #[arg(long, value_name = "DOMAIN,…", value_delimiter = ',', default_value = "94,95,96,97,98,99",
          value_parser = clap::value_parser!(u16).range(0..=100))]
    domains: Vec<u16>,

    /// A foreign program that is missing is an error.
    #[arg(long)]
    require: bool,

    /// One end of this path.
    #[arg(long, hide = true, requires = "role")]
    part: Option<Path>,

    #[arg(long, hide = true, requires = "part")]
    role: Option<Role>,

    #[command(flatten)]
    json: JsonOption,
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    if let (Some(path), Some(role)) = (args.part, args.role) {
        return part::run(path, role);
    }
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    if args.domains.len() < args.paths.len() {
        let wanted = format!("one for each of the {} paths", args.paths.len());
        return Err(Failure::range("--domains", args.domains.len(), wanted));
    }
    let cpu = args.cpu.unwrap_or_else(|| Cpus::choose().measured);
    let plan = Plan {
        paths: args.paths.clone(),
        bytes: args
            .bytes
            .iter()
            .filter_map(|n| usize::try_from(*n).ok())
            .collect(),
        windows: args.windows,
        domains: args.domains.clone(),
        require: args.require,
    };
    let _alone = lock::acquire()?;
    // Children have the policy and the CPU of the thread that starts them. This thread stays an
    // ordinary one: with a real-time priority it can wait in /proc for a process that it keeps from
    // running, without an end.
    let starter = ThreadSpec::new("bench-ros2")
        .policy(fifo_or_other(SUPPORT_PRIORITY))
        .cpu(cpu);
    let (all, left_out) = measure(&plan, &starter)?;
    let setting = Setting {
        readers: 3,
        samples: 500,
        lent: true,
        cpu,
    };
    let (in_process, granted) = in_process(&[1_000_000], setting)?;
    let domain = plan.domains.first().copied().unwrap_or_default();
    let encodings = encoding::measure(&plan.bytes, cpu, domain)?;
    let fragments = fragments::measure(cpu)?;
    let flood = plan.paths.contains(&Path::Executor);
    let flood = flood.then(|| flood::measure(&plan, &starter, Cpus::choose().support));
    let flood = flood.transpose()?;
    let json = Json {
        points: points(&all),
        in_process,
        encodings,
        fragments,
        flood,
        left_out,
        cpu,
        granted,
    };
    json.print();
    files::write_json(args.json.json.as_deref(), "bench-ros2", &json)
}
