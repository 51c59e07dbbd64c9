//! `replenish bench dispatch`: what it costs to bring a message to its callback, for one handle and
//! for a thousand, next to a raw UDP loop.
//!
//! ```text
//!   sender ── WRITE_DATA ─► agent ── DATA ─► one thread: take, callback          (ours)
//!   sender ── WRITE_DATA ─► agent ── DATA ─► dispatcher ─► worker: callback      (threads)
//!   sender ── a datagram of that size ─────► one thread: epoll, recv, count        (waiting)
//!   sender ── a datagram of that size ─────► one thread: recv, count              (baseline)
//!   └───── one CPU ──────────────┘           └───── the measured CPU ──────┘
//! ```
//!
//! Ours is compared with what has as many threads as it has: an executor that the thread spins which
//! waits, as rclc's. A dispatcher and a worker are two threads, with a switch more per message for
//! what a thread of its own gives: policy, priority, budget.
//!
//! The baseline can be woken by datagrams alone. A loop that has timers, too, or that others can stop,
//! needs a second system call per message: that one is *waiting*, the least that an executor can cost.
//!
//! Messages come at a steady rate, to one topic after another. Windows of all take turns, short ones,
//! so that they see the same machine even where that changes from one moment to the next. CPU time
//! and context switches are those of the threads on the measured CPU, as the kernel counts them; the
//! time of a message is from before its sending to the callback (ours passes the agent on the way) or
//! to the end of `recv`. The measured CPU is kept [`awake`], unless that is declined.

mod awake;
mod ours;
mod raw;
mod report;
mod threads;

use crate::load::spec::SUPPORT_PRIORITY;
use crate::load::{MS, Nanos, SEC};
use crate::report::progress::Progress;
use awake::Awake;
use ours::Ours;
use raw::Raw;
use replenish_cli::lock;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_os::{ThreadSpec, clock, spawn};
use report::{Json, Point, Window};
use std::sync::atomic::{AtomicU64, Ordering};

/// Ours in one thread, ours with a worker's, the raw loop that waits, and the raw loop.
const RECEIVERS: usize = 4;
/// How long messages come to one of them without a break, at least. Keeps far from the RT
/// throttle.
const WINDOW: Nanos = 40 * MS;
/// Messages of a window at least.
const MESSAGES: u64 = 10;
/// The pause after that, in which what is under way arrives.
const PAUSE: Nanos = 10 * MS;
/// Of the option `--windows` one is so long.
const UNIT: Nanos = 400 * MS;
/// A message that leaves later than this makes its window void: the machine stood still.
const GAP: Nanos = 5 * MS;

/// Options of `bench dispatch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Subscriptions of the executor, on one worker
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,10,100,1000",
          value_parser = clap::value_parser!(u16).range(1..=1000))]
    handles: Vec<u16>,

    /// Messages per second, of all topics together
    #[arg(long, value_name = "HZ", default_value_t = 1000,
          value_parser = clap::value_parser!(u64).range(10..=10_000))]
    rate: u64,

    /// Times 0.4 s per point, of each receiver, in windows of 0.04 s or 10 messages
    #[arg(long, value_name = "N", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=1000))]
    windows: u64,

    /// The CPU of those that receive
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// Let that CPU sleep between messages, which costs all of them more, by what the machine
    /// forgets in its sleep. It is kept awake otherwise
    #[arg(long)]
    asleep: bool,

    #[command(flatten)]
    json: JsonOption,
}

/// What was received in a window: written by the receiver, read when it is over.
#[derive(Debug)]
struct Received {
    times: Box<[AtomicU64]>,
    count: AtomicU64,
}

impl Received {
    fn new(rate: u64) -> Self {
        let room = usize::try_from(2 * rate).unwrap_or(usize::MAX);
        Self {
            times: (0..room).map(|_| AtomicU64::new(0)).collect(),
            count: AtomicU64::new(0),
        }
    }

    /// A message that was sent at `sent` is here.
    fn note(&self, sent: Nanos) {
        let took = clock::monotonic().saturating_sub(sent);
        let n = self.count.fetch_add(1, Ordering::Relaxed);
        let slot = usize::try_from(n).ok().and_then(|n| self.times.get(n));
        if let Some(slot) = slot {
            slot.store(took, Ordering::Relaxed);
        }
    }

    /// The times so far; from now on anew.
    fn take(&self) -> Vec<i64> {
        let n = usize::try_from(self.count.swap(0, Ordering::AcqRel)).unwrap_or(usize::MAX);
        let times = self.times.iter().take(n);
        times
            .map(|t| i64::try_from(t.load(Ordering::Relaxed)).unwrap_or(i64::MAX))
            .collect()
    }
}

/// One of those that are compared.
trait Receiver {
    /// Sends message `n`; what it carries is the time before its sending.
    fn send(&mut self, n: u64) -> Outcome;

    /// What has come.
    fn received(&self) -> &Received;

    /// CPU time and voluntary context switches of its threads so far.
    fn used(&self) -> Result<threads::Used, Failure>;
}

/// Messages of one window.
fn messages(rate: u64) -> u64 {
    (WINDOW * rate / SEC).max(MESSAGES)
}

/// Windows that take as long as so many units.
fn windows(units: u64, rate: u64) -> u64 {
    (units * UNIT * rate / SEC / messages(rate)).max(units)
}

/// One window of one receiver; `None` if the machine stood still.
fn window(of: &mut dyn Receiver, rate: u64) -> Result<Option<Window>, Failure> {
    let interval = SEC / rate;
    let messages = messages(rate);
    of.received().take();
    let before = of.used()?;
    let start = clock::monotonic() + MS;
    let mut late = 0;
    for n in 0..messages {
        let at = start + n * interval;
        clock::sleep_until(at);
        late = late.max(clock::monotonic().saturating_sub(at));
        of.send(n)?;
    }
    // The pause: for as long as anything comes.
    let end = start + messages * interval + PAUSE;
    clock::sleep_until(end);
    let used = of.used()?.since(&before);
    let times = of.received().take();
    Ok((late < GAP && !times.is_empty()).then_some(Window {
        sent: messages,
        times,
        used,
    }))
}

/// What all windows of a run have in common, and how many they are.
#[derive(Debug, Clone, Copy)]
struct Setting {
    rate: u64,
    windows: u64,
    cpu: usize,
    support: usize,
    awake: bool,
}

/// A window of each.
type Windows = [Window; RECEIVERS];

/// Windows of all in turns until enough of them count; and how many did not.
fn turns(
    setting: Setting,
    mut all: [&mut dyn Receiver; RECEIVERS],
) -> Result<(Vec<Windows>, u64), Failure> {
    let (mut good, mut repeated) = (Vec::new(), 0);
    while (good.len() as u64) < setting.windows && repeated <= setting.windows.max(3) {
        // Back and forth, so that what drifts meets all alike.
        let back = (good.len() + repeated as usize).is_multiple_of(2);
        let mut each = [const { None }; RECEIVERS];
        for n in 0..RECEIVERS {
            let of = if back { RECEIVERS - 1 - n } else { n };
            if let (Some(receiver), Some(slot)) = (all.get_mut(of), each.get_mut(of)) {
                *slot = window(*receiver, setting.rate)?;
            }
        }
        match each {
            [Some(a), Some(b), Some(c), Some(d)] => good.push([a, b, c, d]),
            _ => repeated += 1,
        }
    }
    if good.is_empty() {
        let why = "nothing arrived, or the machine stood still in every window";
        return Err(Failure::refused(why));
    }
    Ok((good, repeated))
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
    files::write_json(args.json.json.as_deref(), &json)
}
