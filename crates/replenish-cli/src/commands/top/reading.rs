//! One look at every program, and what has happened since the look before.

use super::machine::{Machine, program_cpu};
use crate::live::{Found, Program, all};
use crate::time::Nanos;
use replenish_os::clock;
use replenish_recorder::{ChainView, Event, Kind, Role, ThreadView, bucket_end};
use std::collections::HashMap;
use std::path::PathBuf;

/// A worker of a program: its file, and its place there.
pub(super) type Key = (PathBuf, usize);

/// A worker now, and since the look before.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    pub(super) key: Key,
    pub(super) program: String,
    pub(super) pid: u32,
    pub(super) alive: bool,
    pub(super) worker: String,
    pub(super) cpu: Option<u64>,
    pub(super) policy: String,
    pub(super) budget: Option<(Nanos, Nanos)>,
    pub(super) available: Nanos,
    pub(super) low: bool,
    pub(super) exhaustions: u64,
    pub(super) since: Since,
}

/// Changes within the window. Times in nanoseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Since {
    /// CPU time.
    pub(super) used: Nanos,
    pub(super) exhaustions: u64,
    pub(super) callbacks: u64,
    /// Callbacks that ended after their deadline.
    pub(super) late: u64,
    /// Samples for its callbacks that found no room.
    pub(super) drops: u64,
    pub(super) worst_latency: Nanos,
    pub(super) worst_response: Nanos,
}

/// A chain of a program. Times in nanoseconds.
#[derive(Debug, Clone, Default)]
pub(super) struct Chain {
    pub(super) program: String,
    pub(super) name: String,
    pub(super) limit: Option<Nanos>,
    pub(super) bound: Option<Nanos>,
    /// In the window.
    pub(super) ended: u64,
    /// In the window, beyond the limit.
    pub(super) exceeded: u64,
    /// Of those in the window, at most a quarter too high.
    pub(super) longest: Nanos,
    /// Since the start of the program.
    pub(super) worst: Option<Nanos>,
}

/// The shares of the whole host.
#[derive(Debug, Clone, Default)]
pub(super) struct Reading {
    pub(super) rows: Vec<Row>,
    pub(super) chains: Vec<Chain>,
    pub(super) cpus: Vec<Cpu>,
    /// Share of one CPU that programs without a recording take; `None` before the second look.
    pub(super) others: Option<f64>,
    /// Since the look before.
    pub(super) window: Nanos,
    pub(super) programs: usize,
    pub(super) warnings: Vec<String>,
}

/// A CPU: shares from 0 to 1.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cpu {
    pub(super) number: u64,
    /// Of all programs, as the kernel counts.
    pub(super) busy: f64,
    /// Of workers that are pinned to it.
    pub(super) workers: f64,
    /// Budgets that it owes them.
    pub(super) reserved: f64,
}

/// Where the look before has ended, of one thread.
#[derive(Default)]
struct Seen {
    /// It was looked at before.
    known: bool,
    next: u64,
    used: Nanos,
    exhaustions: u64,
}

/// Looks again and again.
#[derive(Default)]
pub(super) struct Reader {
    seen: HashMap<Key, Seen>,
    /// The thread of a file that runs the handle of this name.
    owners: HashMap<(PathBuf, u32), usize>,
    /// Chains at the look before.
    chains: HashMap<Key, ChainView>,
    machine: Machine,
    cpu_of_programs: Nanos,
    at: Option<Nanos>,
}

impl Reader {
    /// `ended`: programs that have ended, too.
    pub(super) fn look(&mut self, ended: bool) -> Reading {
        let now = clock::monotonic();
        let window = self.at.map_or(0, |at| now.saturating_sub(at));
        self.at = Some(now);
        let Found { programs, warnings } = all();
        let programs: Vec<Program> = programs.into_iter().filter(|p| p.alive || ended).collect();
        let mut reading = Reading {
            window,
            programs: programs.len(),
            warnings,
            ..Reading::default()
        };
        let mut cpu_of_programs = 0;
        for program in &programs {
            if program.alive {
                cpu_of_programs += program_cpu(program.view.pid);
            }
            self.rows(program, &mut reading.rows);
        }
        self.chains(&programs, &mut reading.chains);
        let keys: Vec<&Key> = reading.rows.iter().map(|row| &row.key).collect();
        let files: Vec<&PathBuf> = programs.iter().map(|p| &p.path).collect();
        self.seen
            .retain(|key, _| keys.contains(&key) || files.contains(&&key.0));
        self.owners.retain(|(file, _), _| files.contains(&file));
        self.machine(&mut reading, cpu_of_programs);
        reading
    }

    fn rows(&mut self, program: &Program, rows: &mut Vec<Row>) {
        let first = rows.len();
        let mut drops = Vec::new();
        for (n, thread) in program.view.threads.iter().enumerate() {
            let key = (program.path.clone(), n);
            let events = self.news(&key, thread, program);
            if thread.role == Role::Dispatcher {
                drops.extend(
                    events
                        .iter()
                        .filter(|e| e.kind == Kind::Drop)
                        .map(|e| e.name),
                );
                continue;
            }
            for event in events.iter().filter(|e| e.kind == Kind::Begin) {
                if self.owners.len() < MOST_OWNERS {
                    self.owners.insert((program.path.clone(), event.name), n);
                }
            }
            let seen = self.seen.entry(key.clone()).or_default();
            let used = thread.totals.high.saturating_add(thread.totals.low);
            let exhaustions = thread.totals.exhaustions;
            let mut since = tally(&events);
            if std::mem::replace(&mut seen.known, true) {
                since.used = used.saturating_sub(seen.used);
                since.exhaustions = exhaustions.saturating_sub(seen.exhaustions);
            }
            (seen.used, seen.exhaustions) = (used, exhaustions);
            rows.push(Row {
                key,
                program: program.view.program.clone(),
                pid: program.view.pid,
                alive: program.alive,
                worker: thread.name.clone(),
                cpu: thread.cpu,
                policy: thread.policy.clone(),
                budget: thread.budget,
                available: thread.totals.available,
                low: thread.totals.is_low,
                exhaustions,
                since,
            });
        }
        for name in drops {
            let owner = self.owners.get(&(program.path.clone(), name));
            let mut own = rows.iter_mut().skip(first);
            if let Some(row) = own.find(|row| Some(&row.key.1) == owner) {
                row.since.drops += 1;
            }
        }
    }

    fn chains(&mut self, programs: &[Program], chains: &mut Vec<Chain>) {
        let mut before = std::mem::take(&mut self.chains);
        for program in programs {
            for (n, now) in program.view.chains.iter().enumerate() {
                let key = (program.path.clone(), n);
                let seen = before.remove(&key);
                chains.push(since(&program.view.program, now, seen.as_ref()));
                self.chains.insert(key, now.clone());
            }
        }
    }

    /// The events of a thread since the last look; of the first look, a part of the ring.
    fn news(&mut self, key: &Key, thread: &ThreadView, program: &Program) -> Vec<Event> {
        let seen = self.seen.entry(key.clone()).or_default();
        if seen.next == 0 {
            seen.next = thread.written(&program.source).saturating_sub(FIRST);
        }
        let (events, copied) = thread.events_since(&program.source, seen.next);
        seen.next = copied.next.max(seen.next);
        events
    }

    fn machine(&mut self, reading: &mut Reading, cpu_of_programs: Nanos) {
        let busy = self.machine.busy();
        let window = reading.window as f64;
        if reading.window == 0 {
            self.cpu_of_programs = cpu_of_programs;
            return;
        }
        let ours = cpu_of_programs.saturating_sub(self.cpu_of_programs) as f64 / window;
        self.cpu_of_programs = cpu_of_programs;
        let total: f64 = busy.iter().map(|(_, share)| share).sum();
        reading.others = Some((total - ours).max(0.0));
        for (number, busy) in busy {
            let here = |row: &&Row| row.alive && row.cpu == Some(number);
            let here = reading.rows.iter().filter(here);
            let (mut workers, mut reserved) = (0.0, 0.0);
            for row in here {
                workers += row.since.used as f64 / window;
                if let Some((budget, period)) = row.budget {
                    reserved += budget as f64 / period as f64;
                }
            }
            reading.cpus.push(Cpu {
                number,
                busy,
                workers,
                reserved,
            });
        }
    }
}

/// Events of a ring that the first look takes.
const FIRST: u64 = 512;
/// Names of handles that are kept.
const MOST_OWNERS: usize = 100_000;

/// A chain now, and what it did since `before`.
fn since(program: &str, now: &ChainView, before: Option<&ChainView>) -> Chain {
    let grown = |count: fn(&ChainView) -> u64| {
        before.map_or(0, |before| count(now).saturating_sub(count(before)))
    };
    let longest = before.and_then(|before| {
        let mut buckets = now.histogram.iter().zip(&before.histogram);
        buckets.rposition(|(now, before)| now > before)
    });
    let worst = now.worst.map(|(_, latency)| latency);
    let longest = longest.map_or(0, bucket_end);
    Chain {
        program: program.into(),
        name: now.name.clone(),
        limit: now.limit,
        bound: now.bound,
        ended: grown(|chain| chain.ended),
        exceeded: grown(|chain| chain.exceeded),
        longest: longest.min(worst.unwrap_or(0)),
        worst,
    }
}

/// Callbacks in a stretch of events.
fn tally(events: &[Event]) -> Since {
    let mut since = Since::default();
    for event in events {
        let until = event.time.saturating_sub(event.a);
        match event.kind {
            Kind::Begin => since.worst_latency = since.worst_latency.max(until),
            Kind::End => {
                since.callbacks += 1;
                since.worst_response = since.worst_response.max(until);
            }
            Kind::Miss => since.late += 1,
            _ => {}
        }
    }
    since
}
