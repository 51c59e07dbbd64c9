//! Options and one run of `bench dispatch`.

use super::awake::Awake;
use super::ours::Ours;
use super::raw::{self, Raw};
use super::receiver::Setting;
use super::report::{Json, Point};
use super::window::{turns, windows};
use crate::load::spec::SUPPORT_PRIORITY;
use crate::report::progress::Progress;
use replenish_cli::lock;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_os::{ThreadSpec, spawn};

/// Options of `bench dispatch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Subscriptions of the executor, on one worker.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,10,100,1000",
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    handles: Vec<u16>,

    /// Messages per second, of all topics together.
    #[arg(long, value_name = "HZ", default_value_t = 1000,
          value_parser = clap::value_parser!(u64).range(10..=10_000))]
    rate: u64,

    /// Times 0.4 s per point, of each receiver, in windows of 0.04 s or 10 messages.
    #[arg(long, value_name = "N", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=1000))]
    windows: u64,

    /// The CPU of those that receive.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// Let that CPU sleep between messages, which costs all of them more, by what the machine
    /// forgets in its sleep. It is kept awake otherwise.
    #[arg(long)]
    asleep: bool,

    #[command(flatten)]
    json: JsonOption,
}

fn point(setting: Setting, handles: u16) -> Result<Point, Failure> {
    let mut raw = Raw::start(setting, raw::receives)?;
    let mut waiting = Raw::start(setting, raw::waits_and_receives)?;
    let mut ours = Ours::start(setting, handles)?;
    let mut threads = Ours::start_threads(setting, handles)?;
    let turns = turns(setting, [&mut ours, &mut threads, &mut waiting, &mut raw]);
    ours.stop()?;
    threads.stop()?;
    waiting.stop()?;
    raw.stop()?;
    let (windows, repeated) = turns?;
    Ok(Point::new(handles, setting.rate, &windows, repeated))
}

/// Runs the benchmark.
pub(crate) fn run(args: &Args) -> Outcome {
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    let chosen = Cpus::choose();
    let setting = Setting {
        rate: args.rate,
        windows: windows(args.windows, args.rate),
        cpu: args.cpu.unwrap_or(chosen.measured),
        support: chosen.support,
        awake: !args.asleep,
    };
    let _alone = lock::acquire()?;
    let awake = setting
        .awake
        .then(|| Awake::keep(setting.cpu))
        .transpose()?;
    let mut progress = Progress::new();
    let mut points = Vec::new();
    for (n, handles) in args.handles.iter().copied().enumerate() {
        let name = format!("{handles} handles");
        progress.step(n, args.handles.len(), &name);
        // The sender shares a CPU with the agent, below it.
        let policy = fifo_or_other(SUPPORT_PRIORITY - 1);
        let spec = ThreadSpec::new("sender")
            .policy(policy)
            .cpu(setting.support);
        let sender = spawn(spec, move || point(setting, handles)).map_err(Failure::refused)?;
        let point = sender
            .join()
            .map_err(|_| Failure::refused("the sender panicked"))?;
        points.push(point.map_err(|e| e.context(&name))?);
    }
    progress.step(args.handles.len(), args.handles.len(), "done");
    drop(progress);
    awake.map_or(Ok(()), Awake::stop)?;
    let json = Json::new(points, setting);
    json.print();
    files::write_json(args.json.json.as_deref(), "bench-dispatch", &json)
}
