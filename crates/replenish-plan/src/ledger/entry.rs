//! One program's reservations, and their text.
//!
//! TOML under a first line with a checksum (FNV-1a, 64 bits): against half-written and foreign
//! files, not against forgery; that is what file permissions are for.

use crate::guarantee::MAX_PERIOD;
use crate::planner::locks;
use crate::{Nanos, Overheads, Plan, Promise, Request};
use replenish_sim::analysis::{Demand, Section};
use serde::Deserialize;
use sporadic::Policy;
use sporadic::{Low, Params, Tuning};
use std::fmt::Write;

/// Longer files are refused, in bytes.
pub(super) const MAX_BYTES: u64 = 256 << 10;
/// More threads are refused.
const MAX_THREADS: usize = 1024;
const MAGIC: &str = "# replenish reservation 1 ";
/// Locks of one program are numbered below this.
const MAX_LOCKS: usize = 4096;

/// The reservation of one program.
#[derive(Debug, Clone, PartialEq)]
pub struct LedgerEntry {
    /// Its name, for people.
    pub program: String,
    /// Its process id in its own pid namespace, for people.
    pub pid: u32,
    /// The overheads of its plan.
    pub overheads: Overheads,
    /// Its real-time threads: name, CPU, policy, demand, deadline.
    pub threads: Vec<(String, Promise)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EntrySchema {
    program: String,
    pid: u32,
    overheads: [Nanos; 9],
    #[serde(default)]
    thread: Vec<ThreadSchema>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ThreadSchema {
    name: String,
    cpu: Option<usize>,
    /// kind, priority, low (-1: suspend), budget, period, `max_repl`; of `SCHED_DEADLINE` runtime,
    /// deadline and period in the places of budget, low and period.
    policy: (KindSchema, u8, i64, Nanos, Nanos, u16),
    /// cost, period, jitter, suspensions, suspended.
    demand: Option<(Nanos, Nanos, Nanos, u32, Nanos)>,
    deadline: Option<Nanos>,
    /// Lock and length.
    #[serde(default)]
    sections: Vec<(usize, Nanos)>,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum KindSchema {
    /// Time-shared, with locks that it shares with others.
    Other,
    Fifo,
    Sporadic,
    Deadline,
}

impl LedgerEntry {
    /// The part of a plan that other programs have to know.
    #[must_use]
    pub fn of(request: &Request, plan: &Plan, program: &str) -> Self {
        let workers = request.workers.iter().zip(&plan.workers);
        // A request that has a plan has them.
        let mut shared = locks::shared(request).unwrap_or_default().into_iter();
        let mut threads: Vec<(String, Promise)> = workers
            .map(|(asked, planned)| {
                let shared = shared.next().unwrap_or_default();
                let rate = asked.guarantee().map(|g| (g.is_rate(), g.period()));
                let demand = match (rate, planned.amount) {
                    (Some((true, period)), Some(cost)) => Some(Demand {
                        cost,
                        period,
                        ..asked.demand.unwrap_or(Demand::new(cost, period))
                    }),
                    (Some(_), _) => None,
                    _ => asked.demand,
                };
                let promise = Promise {
                    owner: String::new(),
                    cpu: planned.cpu,
                    policy: planned.policy,
                    demand,
                    sections: shared.sections,
                    deadline: planned.deadline.filter(|_| planned.policy != Policy::Other),
                };
                (planned.name.clone(), promise)
            })
            .collect();
        threads.extend(plan.executor.iter().map(|executor| {
            let promise = Promise {
                owner: String::new(),
                cpu: executor.cpu,
                policy: executor.policy,
                demand: None,
                sections: Vec::new(),
                deadline: executor
                    .worst_response
                    .and(executor.policy.params().map(Params::period)),
            };
            ("executor".to_owned(), promise)
        }));
        threads.retain(|(_, p)| p.policy != Policy::Other || !p.sections.is_empty());
        threads.truncate(MAX_THREADS);
        Self {
            program: clean(program, 200),
            pid: std::process::id(),
            overheads: request.machine.overheads,
            threads,
        }
    }

    /// Its promises, for [`Request::promised`]; its locks are numbered from `first_lock` on
    /// ([`Promise::next_lock`]).
    #[must_use]
    pub fn promises(&self, first_lock: usize) -> Vec<Promise> {
        let promise = |(name, promise): &(String, Promise)| {
            let mut promise = promise.clone();
            promise.owner = format!("{name:?} of {} (pid {})", self.program, self.pid);
            promise
                .sections
                .iter_mut()
                .for_each(|s| s.lock += first_lock);
            promise
        };
        self.threads.iter().map(promise).collect()
    }

    pub(super) fn write(&self) -> String {
        let mut body = String::new();
        let overheads = self.overheads.all();
        // Writing to a string cannot fail.
        let mut line = |text: std::fmt::Arguments<'_>| body.write_fmt(text).unwrap_or_default();
        line(format_args!("program = '{}'\n", clean(&self.program, 200)));
        line(format_args!("pid = {}\n", self.pid));
        line(format_args!("overheads = {overheads:?}\n"));
        for (name, promise) in &self.threads {
            line(format_args!("[[thread]]\nname = '{}'\n", clean(name, 63)));
            if let Some(cpu) = promise.cpu {
                line(format_args!("cpu = {cpu}\n"));
            }
            match &promise.policy {
                Policy::Other => line(format_args!("policy = ['other', 0, 0, 0, 0, 0]\n")),
                Policy::Fifo { priority } | Policy::RoundRobin { priority } => {
                    line(format_args!("policy = ['fifo', {priority}, 0, 0, 0, 0]\n"));
                }
                Policy::Sporadic(p) | Policy::KernelSporadic(p) => {
                    let low = match p.low() {
                        Low::Background(low) => i64::from(low),
                        Low::Suspend => -1,
                    };
                    let (priority, repl) = (p.priority(), p.max_repl());
                    let (budget, period) = (p.budget(), p.period());
                    line(format_args!(
                        "policy = ['sporadic', {priority}, {low}, {budget}, {period}, {repl}]\n"
                    ));
                }
                Policy::Deadline {
                    runtime,
                    deadline,
                    period,
                    ..
                } => line(format_args!(
                    "policy = ['deadline', 0, {deadline}, {runtime}, {period}, 0]\n"
                )),
            }
            if let Some(d) = promise.demand {
                let (cost, period, jitter) = (d.cost, d.period, d.jitter);
                let (suspensions, suspended) = (d.suspensions, d.suspended);
                line(format_args!(
                    "demand = [{cost}, {period}, {jitter}, {suspensions}, {suspended}]\n"
                ));
            }
            let sections = promise.sections.iter().map(|s| [s.lock as Nanos, s.length]);
            let sections: Vec<_> = sections.collect();
            if !sections.is_empty() {
                line(format_args!("sections = {sections:?}\n"));
            }
            if let Some(deadline) = promise.deadline {
                line(format_args!("deadline = {deadline}\n"));
            }
        }
        format!("{MAGIC}{:016x}\n{body}", checksum(body.as_bytes()))
    }

    /// Reads what [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// The first error in the text.
    pub(super) fn read(text: &str) -> Result<Self, String> {
        let rest = text.strip_prefix(MAGIC).ok_or("it is no reservation")?;
        let (sum, body) = rest.split_once('\n').ok_or("it is no reservation")?;
        if u64::from_str_radix(sum, 16).ok() != Some(checksum(body.as_bytes())) {
            return Err("its checksum is wrong".into());
        }
        let raw: EntrySchema = toml::from_str(body).map_err(|e| e.message().to_owned())?;
        if raw.thread.len() > MAX_THREADS {
            return Err(format!(
                "{} threads: allowed {MAX_THREADS}",
                raw.thread.len()
            ));
        }
        let [
            switch,
            callback,
            dispatch,
            interrupt,
            latency,
            enforcement,
            slack,
            rearm,
            backoff,
        ] = raw.overheads;
        if raw.overheads.iter().any(|o| *o > Overheads::MOST) {
            return Err("an overhead is above 1 s".into());
        }
        Ok(Self {
            program: clean(&raw.program, 200),
            pid: raw.pid,
            overheads: Overheads {
                context_switch: switch,
                callback,
                dispatch,
                release_interrupt: interrupt,
                latency,
                enforcement,
                tuning: Tuning {
                    slack,
                    min_rearm: rearm,
                    max_backoff: backoff,
                },
            },
            threads: raw
                .thread
                .into_iter()
                .map(thread)
                .collect::<Result<_, _>>()?,
        })
    }
}

fn thread(raw: ThreadSchema) -> Result<(String, Promise), String> {
    let (kind, priority, low, budget, period, repl) = raw.policy;
    let name = clean(&raw.name, 63);
    let wrong = |why: &str| format!("thread {name:?}: {why}");
    let policy = match kind {
        KindSchema::Other => Policy::Other,
        KindSchema::Fifo if (1..=99).contains(&priority) => Policy::Fifo { priority },
        KindSchema::Sporadic if priority <= 99 && period <= MAX_PERIOD => {
            let low = match u8::try_from(low) {
                Ok(low) => Low::Background(low),
                Err(_) => Low::Suspend,
            };
            let params = Params::new(priority, low, budget, period, repl);
            Policy::Sporadic(params.map_err(|e| wrong(&e.to_string()))?)
        }
        KindSchema::Deadline => {
            let deadline = Nanos::try_from(low).unwrap_or(0);
            if !(0 < budget && budget <= deadline && deadline <= period && period <= MAX_PERIOD) {
                return Err(wrong("its policy is out of range"));
            }
            Policy::Deadline {
                runtime: budget,
                deadline,
                period,
                reclaim: false,
            }
        }
        _ => return Err(wrong("its policy is out of range")),
    };
    let demand = raw
        .demand
        .map(|(cost, period, jitter, suspensions, suspended)| Demand {
            cost,
            period,
            jitter,
            suspensions,
            suspended,
        });
    let day = |span: Nanos| span <= MAX_PERIOD;
    let sane = |d: &Demand| {
        d.cost > 0
            && d.period > 0
            && [d.cost, d.period, d.jitter, d.suspended]
                .into_iter()
                .all(day)
    };
    if !demand.as_ref().is_none_or(sane) || !raw.deadline.is_none_or(day) {
        return Err(wrong("its demand or deadline is out of range"));
    }
    let sections = raw.sections.into_iter();
    if sections
        .clone()
        .any(|(lock, length)| lock >= MAX_LOCKS || !day(length))
    {
        return Err(wrong("its sections are out of range"));
    }
    let promise = Promise {
        owner: String::new(),
        cpu: raw.cpu,
        policy,
        demand,
        sections: sections
            .map(|(lock, length)| Section { lock, length })
            .collect(),
        deadline: raw.deadline,
    };
    Ok((name, promise))
}

/// Removes characters that a literal string, or a terminal, does not take; cuts to `most` bytes.
fn clean(text: &str, most: usize) -> String {
    let mut clean = String::new();
    for c in text.chars() {
        let c = if c.is_control() || c == '\'' { '?' } else { c };
        if clean.len() + c.len_utf8() > most {
            break;
        }
        clean.push(c);
    }
    clean
}

fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |sum, byte| {
        (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Machine;

    #[test]
    fn what_is_written_is_read_back_and_every_changed_byte_is_noticed() {
        let params = |low| Params::new(60, low, 3_000_000, 10_000_000, 16).unwrap();
        let promise = |policy| Promise {
            owner: String::new(),
            cpu: Some(3),
            policy,
            demand: None,
            sections: vec![Section { lock: 7, length: 9 }],
            deadline: Some(7),
        };
        let budget = |low| Policy::Sporadic(params(low));
        let entry = LedgerEntry {
            program: "/usr/bin/arm".into(),
            pid: 7,
            overheads: Machine::with_cpus(1).overheads,
            threads: vec![
                ("a".into(), promise(budget(Low::Suspend))),
                ("b".into(), promise(budget(Low::Background(5)))),
                ("c".into(), promise(Policy::Fifo { priority: 9 })),
                (
                    "d".into(),
                    Promise {
                        cpu: None,
                        demand: Some(Demand::new(1, 2)),
                        deadline: None,
                        ..promise(Policy::Deadline {
                            runtime: 1,
                            deadline: 2,
                            period: 3,
                            reclaim: false,
                        })
                    },
                ),
            ],
        };
        let text = entry.write();
        assert_eq!(LedgerEntry::read(&text), Ok(entry));
        for at in 0..text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            assert!(
                LedgerEntry::read(&String::from_utf8(bytes).unwrap()).is_err(),
                "byte {at}"
            );
            assert!(LedgerEntry::read(&text[..at]).is_err(), "cut at {at}");
        }
    }

    #[test]
    fn names_cannot_break_out_of_their_line() {
        let entry = LedgerEntry {
            program: "a'\nb\u{1b}[".repeat(100),
            pid: 1,
            overheads: Overheads::NONE,
            threads: Vec::new(),
        };
        let read = LedgerEntry::read(&entry.write()).unwrap();
        assert!(read.program.starts_with("a??b?[") && read.program.len() <= 200);
    }
}
