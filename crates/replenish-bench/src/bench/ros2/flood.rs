//! A control loop beside a flood on another topic: the worker of the flood pays for it.
//!
//! ```text
//!   ping ──► control: worker "worker" answers, worker "flood" has a budget of its own, same CPU
//!   flood ─► control, 50 000 messages a second, best effort, from another CPU
//! ```
//!
//! Windows with and without the flood take turns, and so does a raw UDP loop on the same CPU beside
//! the same flood: what that loses the machine takes, and no executor can give it back. Genuine rcl
//! has such a loop afterwards, and a thread of the same priority that takes the flood.

use super::pair::{Pair, Process};
use super::path::Path;
use super::report::Flood;
use super::windows::{OFF, ON, Plan};
use crate::load::{MS, Nanos, SEC};
use replenish_cli::machine::stats::{Sorted, us};
use replenish_cli::outcome::Failure;
use replenish_os::{Policy, ThreadSpec, clock, spawn};

/// Messages of the flood in a second.
pub(super) const RATE: u64 = 50_000;
/// Bytes of a control message.
const BYTES: usize = 64;

/// Measures it; `starter` is the thread that starts the receiving processes, `support` the CPU of
/// the flood.
pub(super) fn measure(plan: &Plan, starter: &ThreadSpec, support: usize) -> Result<Flood, Failure> {
    let domain = plan.domains.first().copied().unwrap_or_default();
    let missing = |reason| Failure::refused(reason);
    let mut pair = begin(starter, (Path::Executor, "control"), domain)?.map_err(missing)?;
    let mut raw = begin(starter, (Path::RawUdp, "echo"), domain)?.map_err(missing)?;
    let mut flood = flooder(support, domain)?;
    let (mut ours, mut bare) = (Loop::default(), Loop::default());
    // Samples that were lost during discovery are not counted.
    let (mut sent, before) = (0, Counts::ask(&mut pair)?);
    for round in 0..=plan.windows {
        for with in [false, true] {
            for (with_executor, times) in [(true, &mut ours), (false, &mut bare)] {
                let began = Counts::ask(&mut pair)?;
                if with {
                    flood.tell(&format!("flood {}", ON + 20 * MS))?;
                    clock::sleep_until(clock::monotonic() + 10 * MS);
                }
                let loops = if with_executor { &mut pair } else { &mut raw };
                let window = loops.window(BYTES, ON / MS, MS)?;
                let spent = Counts::ask(&mut pair)?;
                if with {
                    sent += number(flood.line()?.split(' ').nth(1))?;
                }
                clock::sleep_until(clock::monotonic() + 2 * OFF);
                if round > 0 {
                    times.add(with, within(ON, window.times), &began, &spent);
                }
            }
        }
    }
    let dropped = Counts::ask(&mut pair)?.lost.saturating_sub(before.lost);
    drop((pair, raw, flood));
    let rcl = plan.paths.contains(&Path::RclFastdds);
    let rcl = rcl
        .then(|| beside_rcl(plan, starter, support))
        .transpose()?;
    let rcl = rcl.flatten();
    Ok(Flood {
        quiet_p99_us: p99(&ours.quiet),
        flood_p99_us: p99(&ours.flooded),
        raw_quiet_p99_us: p99(&bare.quiet),
        raw_flood_p99_us: p99(&bare.flooded),
        rcl_quiet_p99_us: rcl.as_ref().map(|rcl| p99(&rcl.quiet)),
        rcl_flood_p99_us: rcl.as_ref().map(|rcl| p99(&rcl.flooded)),
        dispatcher_quiet_cpu: ours.share(false, |cpu| cpu.0),
        dispatcher_flood_cpu: ours.share(true, |cpu| cpu.0),
        worker_flood_cpu: ours.share(true, |cpu| cpu.1),
        sent,
        dropped,
    })
}

/// A pair whose processes a thread as `starter` says starts.
fn begin(
    starter: &ThreadSpec,
    (path, echo): (Path, &'static str),
    domain: u16,
) -> Result<Result<Pair, String>, Failure> {
    let start = spawn(starter.clone(), move || {
        Pair::start_with(path, echo, domain)
    });
    let pair = start.map_err(Failure::refused)?.join();
    pair.map_err(|_| Failure::refused("a thread panicked"))?
}

/// The process that sends the flood from `support`, when it has found whom to.
fn flooder(support: usize, domain: u16) -> Result<Process, Failure> {
    let start = ThreadSpec::new("flood").policy(Policy::Other).cpu(support);
    let flood = spawn(start, move || {
        Process::part(Path::Executor, "flood", domain)
    });
    let flood = flood.map_err(Failure::refused)?.join();
    let flood = flood.map_err(|_| Failure::refused("a thread panicked"))??;
    let flood = flood.map_err(Failure::refused)?;
    flood.line()?;
    Ok(flood)
}

/// The round trips of rcl with and without the same flood; `None` if it is not there.
fn beside_rcl(plan: &Plan, starter: &ThreadSpec, support: usize) -> Result<Option<Loop>, Failure> {
    let domain = plan.domains.last().copied().unwrap_or_default();
    let Ok(mut pair) = begin(starter, (Path::RclFastdds, "control"), domain)? else {
        return Ok(None);
    };
    let mut flood = flooder(support, domain)?;
    let mut times = Loop::default();
    for round in 0..=plan.windows {
        for with in [false, true] {
            if with {
                flood.tell(&format!("flood {}", ON + 20 * MS))?;
                clock::sleep_until(clock::monotonic() + 10 * MS);
            }
            let window = pair.window(BYTES, ON / MS, MS)?;
            if with {
                flood.line()?;
            }
            clock::sleep_until(clock::monotonic() + 2 * OFF);
            if round > 0 {
                let to = if with {
                    &mut times.flooded
                } else {
                    &mut times.quiet
                };
                to.extend(within(ON, window.times));
            }
        }
    }
    Ok(Some(times))
}

/// Round trips that began within a time, each a millisecond after the one before, or when that one
/// was over: the flood does not last longer.
fn within(time: Nanos, trips: Vec<i64>) -> impl Iterator<Item = i64> {
    let mut began = 0_u64;
    trips.into_iter().take_while(move |trip| {
        let keeps = began < time;
        let took = u64::try_from(*trip).unwrap_or(0);
        began += took.div_ceil(MS).max(1) * MS;
        keeps
    })
}

fn p99(times: &[i64]) -> f64 {
    us(Sorted::new(times.to_vec()).percentile(99))
}

/// The round trips of a loop, and the CPU time of dispatcher and flooded worker in its windows.
#[derive(Default)]
struct Loop {
    quiet: Vec<i64>,
    flooded: Vec<i64>,
    cpu: [(Nanos, Nanos, Nanos); 2],
}

impl Loop {
    fn add(
        &mut self,
        flooded: bool,
        times: impl Iterator<Item = i64>,
        began: &Counts,
        ended: &Counts,
    ) {
        let [quiet, flood] = &mut self.cpu;
        let (to, cpu) = if flooded {
            (&mut self.flooded, flood)
        } else {
            (&mut self.quiet, quiet)
        };
        to.extend(times);
        cpu.0 += ended.dispatcher.saturating_sub(began.dispatcher);
        cpu.1 += ended.worker.saturating_sub(began.worker);
        cpu.2 += ended.at.saturating_sub(began.at);
    }

    /// A thread's share of a CPU.
    fn share(&self, flooded: bool, of: fn(&(Nanos, Nanos, Nanos)) -> Nanos) -> f64 {
        let [quiet, flood] = &self.cpu;
        let cpu = if flooded { flood } else { quiet };
        of(cpu) as f64 / cpu.2.max(1) as f64
    }
}

/// Counts of the control process: samples of the flood that are lost, and CPU times.
struct Counts {
    lost: u64,
    dispatcher: Nanos,
    worker: Nanos,
    at: Nanos,
}

impl Counts {
    fn ask(pair: &mut Pair) -> Result<Self, Failure> {
        let line = pair.ask_echo("counts")?;
        let mut words = line.split(' ').skip(1);
        let mut next = || number(words.next());
        Ok(Self {
            lost: next()?,
            dispatcher: next()?,
            worker: next()?,
            at: clock::monotonic(),
        })
    }
}

fn number(word: Option<&str>) -> Result<u64, Failure> {
    let word = word.unwrap_or_default();
    word.parse()
        .map_err(|_| Failure::refused(format!("{word:?} is no number")))
}

/// Sends 50 messages each millisecond through `publish` for so long; how many.
pub(super) fn pour(time: Nanos, publish: &mut dyn FnMut()) -> u64 {
    let (begin, mut sent) = (clock::monotonic(), 0);
    let due = |now: Nanos| (now - begin) * RATE / SEC;
    while clock::monotonic() < begin + time {
        let now = clock::monotonic();
        while sent < due(now) {
            publish();
            sent += 1;
        }
        clock::sleep_until(now + MS);
    }
    sent
}
