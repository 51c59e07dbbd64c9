//! Reads a deployment file. An error names its place.

use super::deployment::{Chain, Deployment, Described, Load};
use super::error::{FileError, Source};
use super::schema;
use crate::{ExecutorRequest, Machine, Overheads, Requirement};
use replenish_sim::{Overflow, Releases};
use std::path::Path;
use toml::Spanned;

pub(super) type Found<T> = Result<T, FileError>;

/// Longer files are refused, in bytes.
pub const MAX_FILE: u64 = 4 << 20;
/// More workers are refused.
pub const MAX_WORKERS: usize = 4096;
/// The highest number that a CPU may have: `machine.cpus` counts as far.
const MAX_CPU: usize = 1023;

impl Deployment {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, or as [`parse`](Self::parse).
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let file = path.display().to_string();
        let unreadable = |message: String| FileError {
            file: file.clone(),
            line: 0,
            column: 0,
            field: String::new(),
            message,
        };
        let facts = std::fs::metadata(path).map_err(|e| unreadable(e.to_string()))?;
        if facts.len() > MAX_FILE {
            let message = format!("{} bytes: allowed up to {MAX_FILE}", facts.len());
            return Err(unreadable(message));
        }
        let text = std::fs::read_to_string(path).map_err(|e| unreadable(e.to_string()))?;
        Self::parse(&text, &file)
    }

    /// Makes sense of a text; `file` names it in errors.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place, its field and what is allowed.
    pub fn parse(text: &str, file: &str) -> Result<Self, FileError> {
        parse(Source {
            file: file.into(),
            text: text.into(),
        })
    }
}

/// Parses the whole file.
fn parse(source: Source) -> Found<Deployment> {
    let file: schema::File = toml::from_str(&source.text).map_err(|e| source.wrong_toml(&e))?;
    let machine_given = file.machine.cpus.is_some();
    let parser = Parser {
        source: &source,
        machine_given,
    };
    let overheads_given = file.machine.overheads.all().map(Option::is_some);
    let mut machine = parser.machine(&file.machine)?;
    if file.worker.len() > MAX_WORKERS {
        let message = format!("{} workers: allowed up to {MAX_WORKERS}", file.worker.len());
        return Err(source.error(&(0..0), message));
    }
    parser.names(&file.worker)?;
    let mut locks = Vec::new();
    let mut workers = Vec::with_capacity(file.worker.len());
    for worker in &file.worker {
        workers.push(parser.worker(worker, &file.worker, &machine, &mut locks)?);
    }
    let executor = parser.executor(&file.executor, &machine, &workers)?;
    let programs = parser.programs(&file.program, &machine)?;
    if !machine_given {
        let pinned = workers.iter().filter_map(|w| w.cpu);
        let pinned = pinned.chain(programs.iter().filter_map(|p| p.cpu));
        let own = match &executor {
            ExecutorRequest::Planned { cpu } | ExecutorRequest::Policy { cpu, .. } => *cpu,
            ExecutorRequest::None => None,
        };
        machine.cpus.extend(pinned.chain(own));
        machine.cpus.sort_unstable();
        machine.cpus.dedup();
    }
    let chains = file.chain.iter().map(|c| parser.chain(c, &workers));
    let chains = chains.collect::<Found<Vec<_>>>()?;
    for chain in &chains {
        link(chain, &mut workers);
    }
    Ok(Deployment {
        machine,
        executor,
        workers,
        chains,
        programs,
        locks,
        machine_given,
        overheads_given,
        source,
    })
}

/// A stage that has no releases of its own is released by the stage before it.
fn link(chain: &Chain, workers: &mut [Described]) {
    for pair in chain.workers.windows(2) {
        let &[from, to] = pair else { continue };
        let led = workers.get(to).is_some_and(|w| w.load.releases.is_none());
        if let Some(load) = workers.get_mut(from).map(|w| &mut w.load)
            && led
            && !load.sends.contains(&to)
        {
            load.sends.push(to);
        }
    }
    for &to in chain.workers.iter().skip(1) {
        if let Some(load) = workers.get_mut(to).map(|w| &mut w.load) {
            load.releases.get_or_insert(Releases::Never);
        }
    }
}

pub(super) struct Parser<'s> {
    pub(super) source: &'s Source,
    /// Whether the file says which CPUs there are.
    machine_given: bool,
}

impl Parser<'_> {
    pub(super) fn wrong<T, R>(&self, at: &Spanned<T>, message: impl Into<String>) -> Found<R> {
        Err(self.source.error(&at.span(), message))
    }

    fn machine(&self, written: &schema::Machine) -> Found<Machine> {
        let mut machine = Machine::with_cpus(1);
        if let Some(cpus) = &written.cpus {
            if cpus.get_ref().0.is_empty() {
                return self.wrong(cpus, "no CPU: at least one is needed");
            }
            machine.cpus.clone_from(&cpus.get_ref().0);
        }
        if let Some(enforcer) = &written.enforcer_priority {
            machine.enforcer_priority = *enforcer.get_ref();
            if !(4..=99).contains(enforcer.get_ref()) {
                return self.wrong(enforcer, "allowed 4 to 99");
            }
        }
        if let Some(priorities) = &written.priorities {
            let [low, high] = *priorities.get_ref();
            let most = machine.enforcer_priority - 2;
            if low < 2 || low > high || high > most {
                let allowed = format!("allowed two numbers from 2 to {most}, the lower one first");
                return self.wrong(priorities, allowed);
            }
            machine.priorities = low..=high;
        }
        if let Some(share) = &written.real_time_share {
            machine.real_time_share = *share.get_ref();
            if !(*share.get_ref() > 0.0 && *share.get_ref() <= 1.0) {
                return self.wrong(share, "allowed above 0 up to 1.0");
            }
        }
        let given = written.overheads.all();
        for (given, own) in given.into_iter().zip(machine.overheads.all_mut()) {
            let Some(given) = given else { continue };
            *own = given.get_ref().0;
            if *own > Overheads::MOST {
                return self.wrong(given, "allowed up to 1 s");
            }
        }
        Ok(machine)
    }

    fn names(&self, workers: &[schema::Worker]) -> Found<()> {
        let mut handles: Vec<&str> = Vec::new();
        for (index, worker) in workers.iter().enumerate() {
            self.name(&worker.name)?;
            let name = worker.name.get_ref();
            if workers.iter().take(index).any(|w| w.name.get_ref() == name) {
                return self.wrong(&worker.name, format!("there is a worker {name:?} already"));
            }
            for handle in &worker.handles {
                if handles.contains(&handle.get_ref().as_str()) {
                    let message = format!("handle {:?} has a worker already", handle.get_ref());
                    return self.wrong(handle, message);
                }
                handles.push(handle.get_ref());
            }
        }
        Ok(())
    }

    pub(super) fn name(&self, written: &Spanned<String>) -> Found<()> {
        let name = written.get_ref();
        let odd = |c: char| c.is_control() || c == '/';
        if name.is_empty() || name.len() > 63 || name.contains(odd) {
            let allowed = "a name has 1 to 63 bytes, without / and control characters";
            return self.wrong(written, allowed);
        }
        Ok(())
    }

    pub(super) fn cpu(
        &self,
        cpu: Option<&Spanned<usize>>,
        machine: &Machine,
    ) -> Found<Option<usize>> {
        match cpu {
            Some(cpu) if self.machine_given && !machine.cpus.contains(cpu.get_ref()) => self.wrong(
                cpu,
                format!("it is none of machine.cpus: allowed {:?}", machine.cpus),
            ),
            Some(cpu) if *cpu.get_ref() > MAX_CPU => {
                self.wrong(cpu, format!("allowed 0 to {MAX_CPU}"))
            }
            other => Ok(other.map(|cpu| *cpu.get_ref())),
        }
    }

    fn worker(
        &self,
        written: &schema::Worker,
        all: &[schema::Worker],
        machine: &Machine,
        locks: &mut Vec<String>,
    ) -> Found<Described> {
        let scheduling = match (&written.guarantee, &written.policy) {
            (Some(_), Some(policy)) => {
                let message = "a worker has either a guarantee or a policy, not both";
                return self.wrong(policy, message);
            }
            (Some(guarantee), None) => Some(Requirement::Guarantee(self.guarantee(guarantee)?)),
            (None, Some(policy)) => Some(Requirement::Policy(self.policy(policy, machine)?)),
            (None, None) => None,
        };
        if let (Some(deadline), Some(_)) = (&written.deadline, &written.guarantee) {
            let message = "the deadline of a guaranteed worker belongs into its guarantee";
            return self.wrong(deadline, message);
        }
        let mut sends = Vec::new();
        for to in &written.sends {
            match all.iter().position(|w| w.name.get_ref() == to.get_ref()) {
                Some(at) => sends.push(at),
                None => return self.wrong(to, format!("there is no worker {:?}", to.get_ref())),
            }
        }
        let lock = |lock: &Spanned<schema::Lock>| {
            let lock = lock.get_ref();
            let known = locks.iter().position(|l| *l == lock.name);
            let at = known.unwrap_or_else(|| {
                locks.push(lock.name.clone());
                locks.len() - 1
            });
            (at, lock.holds.map(|holds| holds.0))
        };
        let queue = match &written.queue {
            Some(queue) if *queue.get_ref() > 4096 => {
                return self.wrong(queue, "allowed 0 to 4096");
            }
            Some(queue) => *queue.get_ref(),
            None => 1,
        };
        let releases = written
            .releases
            .as_ref()
            .map(|r| self.releases(r))
            .transpose()?;
        Ok(Described {
            name: written.name.get_ref().clone(),
            handles: written
                .handles
                .iter()
                .map(|h| h.get_ref().clone())
                .collect(),
            cpu: self.cpu(written.cpu.as_ref(), machine)?,
            scheduling,
            load: Load {
                runs: written.runs.as_ref().map(|t| t.get_ref().0.clone()),
                blocks: written.blocks.as_ref().map(|t| t.get_ref().0.clone()),
                releases,
                queue,
                overflow: match written.overflow {
                    Some(schema::Overflow::DropNewest) => Overflow::DropNewest,
                    Some(schema::Overflow::DropOldest) | None => Overflow::DropOldest,
                },
                sends,
                locks: written.locks.iter().map(lock).collect(),
                deadline: written.deadline.as_ref().map(|d| d.get_ref().0),
            },
            place: written.name.span(),
            handle_places: written.handles.iter().map(Spanned::span).collect(),
        })
    }

    fn executor(
        &self,
        written: &schema::Executor,
        machine: &Machine,
        workers: &[Described],
    ) -> Found<ExecutorRequest> {
        let cpu = self.cpu(written.cpu.as_ref(), machine)?;
        if let Some(policy) = &written.policy {
            let policy = self.policy(policy, machine)?;
            return Ok(ExecutorRequest::Policy { policy, cpu });
        }
        // Timers need no executor; everything else comes as a message.
        let mut handles = workers.iter().flat_map(|w| &w.handles).peekable();
        let timers = |handle: &String| handle.contains("/timer:");
        if handles.peek().is_some() && handles.all(timers) {
            return Ok(ExecutorRequest::None);
        }
        Ok(ExecutorRequest::Planned { cpu })
    }

    fn chain(&self, written: &schema::Chain, workers: &[Described]) -> Found<Chain> {
        let mut stages: Vec<usize> = Vec::new();
        for name in written.workers.get_ref() {
            let known = workers.iter().position(|w| w.name == *name.get_ref());
            match known {
                None => {
                    return self.wrong(name, format!("there is no worker {:?}", name.get_ref()));
                }
                Some(at) if stages.contains(&at) => {
                    return self.wrong(name, "a worker can be in a chain once");
                }
                Some(at) => stages.push(at),
            }
        }
        if stages.len() < 2 {
            return self.wrong(&written.workers, "a chain has at least two workers");
        }
        Ok(Chain {
            name: written.name.get_ref().clone(),
            workers: stages,
            deadline: written.deadline.as_ref().map(|d| d.get_ref().0),
        })
    }
}
