//! The orchestrator: starts the three parts, hands out the grid, collects windows, ends them.

use super::child::{Child, News};
use super::summary::{Summary, summarise};
use super::windows::{Collector, REPEATS, Window};
use crate::load::grid::Grid;
use crate::load::simulated::{self, Measured};
use crate::load::spec::{High, Spec};
use crate::load::theory;
use crate::load::{MS, Nanos};
use crate::roles::protocol::{Event, Mode, PongEnd, Ready, ThreadRow};
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::clock;
use std::collections::BTreeMap;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;

/// A part must have set itself up within this time.
const SET_UP: Nanos = 5_000 * MS;
/// From the last part's readiness to the first message.
const LEAD: Nanos = 150 * MS;
/// After the end of a window a part may be silent for this long.
const SILENCE: Nanos = 1_300 * MS;
/// The longest time that a part has to end on request.
const WIND_DOWN: Duration = Duration::from_secs(2);

/// The plan of a run: load, windows and CPUs.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    /// The load.
    pub spec: Spec,
    /// Windows that must count.
    pub windows: u64,
    /// Offers the load without pauses; nothing is repeated then.
    pub continuous: bool,
    /// Refuses to run without real enforcement.
    pub strict: bool,
    /// The CPUs of the parts.
    pub cpus: Cpus,
}

/// The result of a run.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    /// The windows in which load was offered.
    pub grid: Grid,
    /// The windows that count.
    pub windows: Vec<Window>,
    /// The numbers.
    pub summary: Summary,
    /// Mode in which budgets were held.
    pub mode: Mode,
    /// The threads of all parts.
    pub threads: Vec<ThreadRow>,
    /// Pong's statistics.
    pub end: PongEnd,
    /// Notes of the parts, each with the name of its part.
    pub notes: Vec<String>,
}

/// Runs `plan`; calls `progress` after every window.
pub(crate) fn run(
    plan: &Plan,
    stop: &Stop,
    progress: &mut dyn FnMut(&Collector),
) -> Result<Run, Failure> {
    let (news, inbox) = mpsc::channel();
    let mut inbox = Inbox {
        inbox,
        stop,
        ready: BTreeMap::new(),
        notes: Vec::new(),
        end: None,
    };

    let support = format!("--cpu={}", plan.cpus.support);
    let args = vec!["--listen=127.0.0.1:0".to_string(), support.clone()];
    let mut agent = Child::spawn("agent", &args, news.clone())?;
    let address = inbox
        .await_ready("agent")?
        .address
        .clone()
        .ok_or_else(|| Failure::refused("the agent did not say where it listens"))?;

    let agent_option = format!("--agent={address}");
    let mut pong = Child::spawn("pong", &pong_args(plan, &agent_option), news.clone())?;
    let ping_args = [agent_option, support, interval(&plan.spec)];
    let mut ping = Child::spawn("ping", &ping_args, news)?;
    let mode = inbox.await_ready("pong")?.mode.unwrap_or(Mode::Deferred);
    inbox.await_ready("ping")?;

    let epoch = clock::monotonic() + LEAD;
    let grid = if plan.continuous {
        Grid::continuous(epoch, plan.spec.interval)
    } else {
        Grid::windowed(epoch, plan.spec.period, plan.spec.interval)
    };
    let mut collector = collector(plan, &grid, mode);
    let deadline = epoch + collector.longest(&grid) + 3_000 * MS;
    pong.start(&grid)?;
    ping.start(&grid)?;
    let mut heard = [("ping", epoch), ("pong", epoch)];
    while !collector.is_complete() {
        let (quiet, since) = if heard[0].1 <= heard[1].1 {
            heard[0]
        } else {
            heard[1]
        };
        match inbox.next(deadline.min(since + grid.cycle() + SILENCE))? {
            Some((_, Event::PongWindow(w))) => {
                heard[1].1 = clock::monotonic();
                collector.pong(w);
            }
            Some((_, Event::PingWindow(w))) => {
                heard[0].1 = clock::monotonic();
                collector.ping(w);
            }
            Some((name, Event::Link { up: false, detail })) => {
                return Err(Failure::refused(format!("{name} lost the agent: {detail}")));
            }
            Some(_) => continue,
            None => {
                return Err(Failure::refused(format!(
                    "the {quiet} process does not report any more"
                )));
            }
        }
        progress(&collector);
    }

    for part in [&mut ping, &mut pong, &mut agent] {
        part.stop();
        inbox.ending(part, clock::monotonic() + 2_000 * MS)?;
    }
    let repeated = collector.repeated();
    let windows = collector.counted().to_vec();
    let end = inbox.end.take().unwrap_or_default();
    let mut summary = summarise(&plan.spec, &grid, &windows, repeated);
    if !grid.is_continuous() {
        let measured = Measured {
            costs: end.costs,
            arrivals: [&end.arrivals_high, &end.arrivals_low],
        };
        summary = summary.simulated(|w| simulated::window(&plan.spec, &grid, w, &measured))?;
    }
    Ok(Run {
        summary,
        grid,
        windows,
        mode,
        threads: inbox.threads(),
        end,
        notes: inbox.notes,
    })
}

/// The collector of the windows that count.
///
/// As many windows as asked for may be offered again, and at least [`REPEATS`].
fn collector(plan: &Plan, grid: &Grid, mode: Mode) -> Collector {
    let repeats = if plan.continuous {
        0
    } else {
        plan.windows.max(REPEATS)
    };
    let t = theory::per_window(&plan.spec, grid, grid.messages());
    // Others may have their share of the CPU without a gap of the clocks: other programs without
    // real-time priority, ping and agent where there is one CPU only. A low callback that sleeps
    // leaves the CPU idle when the high one has nothing to do.
    let exclusive = mode == Mode::Enforced && !plan.cpus.is_single();
    let busy = match plan.spec.low_sleep_percent {
        0 if exclusive => t.high_priority + t.low,
        _ => 0,
    };
    Collector::new(plan.windows, repeats, busy)
}

fn interval(spec: &Spec) -> String {
    format!("--interval={}", spec.interval / MS)
}

fn pong_args(plan: &Plan, agent: &str) -> Vec<String> {
    let spec = &plan.spec;
    let mut args = vec![
        agent.to_string(),
        format!("--cpu={}", plan.cpus.measured),
        format!("--monitor-cpu={}", plan.cpus.support),
        format!("--burst={}", spec.burst / MS),
        format!("--low-sleep={}", spec.low_sleep_percent),
    ];
    match spec.high {
        High::Sporadic {
            budget,
            period,
            background,
        } => args.extend([
            format!("--budget={}", budget / MS),
            format!("--period={}", period / MS),
            format!("--background={background}"),
        ]),
        High::Fifo => args.push("--fifo".to_string()),
    }
    if plan.strict {
        args.push("--strict".to_string());
    }
    args
}

/// Events of all parts, in order of arrival.
struct Inbox<'a> {
    inbox: Receiver<News>,
    stop: &'a Stop,
    ready: BTreeMap<&'static str, Ready>,
    notes: Vec<String>,
    end: Option<PongEnd>,
}

impl Inbox<'_> {
    /// The next event; `None` at `deadline`. A part that ends, or a signal, is an error.
    fn next(&mut self, deadline: Nanos) -> Result<Option<(&'static str, Event)>, Failure> {
        loop {
            if self.stop.is_triggered() {
                return Err(Failure::refused("interrupted"));
            }
            let left = deadline.saturating_sub(clock::monotonic());
            if left == 0 {
                return Ok(None);
            }
            let slice = Duration::from_nanos(left.min(50 * MS));
            match self.inbox.recv_timeout(slice) {
                Ok(News::Event(name, event)) => {
                    self.note(name, &event);
                    return Ok(Some((name, event)));
                }
                Ok(News::Ended(name)) => {
                    return Err(Failure::refused(format!(
                        "the {name} process ended unexpectedly"
                    )));
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Failure::refused("every part has ended"));
                }
            }
        }
    }

    fn note(&mut self, name: &'static str, event: &Event) {
        match event {
            Event::Ready(ready) => {
                self.ready.insert(name, ready.clone());
            }
            Event::Note { text } => self.notes.push(format!("{name}: {text}")),
            Event::Link { up, detail } => {
                self.notes.push(format!("{name}: link up: {up}, {detail}"));
            }
            Event::PongEnd(end) => self.end = Some(end.clone()),
            Event::PongWindow(_) | Event::PingWindow(_) => {}
        }
    }

    /// Waits until part `name` is ready.
    fn await_ready(&mut self, name: &'static str) -> Result<&Ready, Failure> {
        let deadline = clock::monotonic() + SET_UP;
        while !self.ready.contains_key(name) {
            if self.next(deadline)?.is_none() {
                let limit = SET_UP / MS;
                return Err(Failure::refused(format!(
                    "{name} was not ready within {limit} ms"
                )));
            }
        }
        self.ready
            .get(name)
            .ok_or_else(|| Failure::refused(format!("{name} is not ready")))
    }

    /// Takes what a part says while it ends, and waits for the end of its process.
    fn ending(&mut self, part: &mut Child, deadline: Nanos) -> Result<(), Failure> {
        loop {
            let left = deadline.saturating_sub(clock::monotonic());
            match self.inbox.recv_timeout(Duration::from_nanos(left)) {
                Ok(News::Event(name, event)) => self.note(name, &event),
                Ok(News::Ended(name)) if name == part.name() => break,
                Ok(News::Ended(name)) => {
                    return Err(Failure::refused(format!(
                        "the {name} process ended unexpectedly"
                    )));
                }
                Err(_) => break,
            }
        }
        let status = part.wait(WIND_DOWN)?;
        if status.success() {
            Ok(())
        } else {
            Err(Failure::refused(format!(
                "the {} process failed: {status}",
                part.name()
            )))
        }
    }

    fn threads(&self) -> Vec<ThreadRow> {
        ["pong", "ping", "agent"]
            .iter()
            .filter_map(|name| self.ready.get(name))
            .flat_map(|ready| ready.threads.clone())
            .collect()
    }
}
