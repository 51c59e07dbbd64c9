//! From what is written to what is meant, with an error at the place of whatever makes no sense.

use super::error::{FileError, Source};
use super::raw;
use super::{Chain, Deployment, Described, Load, MAX_WORKERS};
use crate::{ExecutorRequest, Machine, Overheads, Requirement};
use replenish_sim::{Overflow, Releases};
use toml::Spanned;

pub(super) type Found<T> = Result<T, FileError>;

/// Reads the whole file.
pub(super) fn read(source: Source) -> Found<Deployment> {
    let file: raw::File = toml::from_str(&source.text).map_err(|e| source.wrong_toml(&e))?;
    let reader = Reader { source: &source };
    let machine_given = file.machine.cpus.is_some();
    let overheads_given = file.machine.overheads.all().map(Option::is_some);
    let machine = reader.machine(&file.machine)?;
    if file.worker.len() > MAX_WORKERS {
        let message = format!("{} workers: allowed up to {MAX_WORKERS}", file.worker.len());
        return Err(source.error(&(0..0), message));
    }
    reader.names(&file.worker)?;
    let mut locks = Vec::new();
    let mut workers = Vec::with_capacity(file.worker.len());
    for worker in &file.worker {
        workers.push(reader.worker(worker, &file.worker, &machine, &mut locks)?);
    }
    let executor = reader.executor(&file.executor, &machine, &workers)?;
    let chains = file.chain.iter().map(|c| reader.chain(c, &workers));
    let chains = chains.collect::<Found<Vec<_>>>()?;
    for chain in &chains {
        link(chain, &mut workers);
    }
    Ok(Deployment {
        machine,
        executor,
        workers,
        chains,
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

pub(super) struct Reader<'s> {
    pub(super) source: &'s Source,
}

impl Reader<'_> {
    pub(super) fn wrong<T, R>(&self, at: &Spanned<T>, message: impl Into<String>) -> Found<R> {
        Err(self.source.error(&at.span(), message))
    }

    fn machine(&self, raw: &raw::Machine) -> Found<Machine> {
        let mut machine = Machine::with_cpus(1);
        if let Some(cpus) = &raw.cpus {
            if cpus.get_ref().0.is_empty() {
                return self.wrong(cpus, "no CPU: at least one is needed");
            }
            machine.cpus.clone_from(&cpus.get_ref().0);
        }
        if let Some(enforcer) = &raw.enforcer_priority {
            machine.enforcer_priority = *enforcer.get_ref();
            if !(4..=99).contains(enforcer.get_ref()) {
                return self.wrong(enforcer, "allowed 4 to 99");
            }
        }
        if let Some(priorities) = &raw.priorities {
            let [low, high] = *priorities.get_ref();
            let most = machine.enforcer_priority - 2;
            if low < 2 || low > high || high > most {
                let allowed = format!("allowed two numbers from 2 to {most}, the lower one first");
                return self.wrong(priorities, allowed);
            }
            machine.priorities = low..=high;
        }
        if let Some(share) = &raw.real_time_share {
            machine.real_time_share = *share.get_ref();
            if !(*share.get_ref() > 0.0 && *share.get_ref() <= 1.0) {
                return self.wrong(share, "allowed above 0 up to 1.0");
            }
        }
        let given = raw.overheads.all();
        for (given, own) in given.into_iter().zip(machine.overheads.all_mut()) {
            let Some(given) = given else { continue };
            *own = given.get_ref().0;
            if *own > Overheads::MOST {
                return self.wrong(given, "allowed up to 1 s");
            }
        }
        Ok(machine)
    }

    fn names(&self, workers: &[raw::Worker]) -> Found<()> {
        let mut handles: Vec<&str> = Vec::new();
        for (index, worker) in workers.iter().enumerate() {
            let name = worker.name.get_ref();
            if name.is_empty()
                || name.len() > 63
                || name.contains(|c: char| c.is_control() || c == '/')
            {
                let allowed = "a name has 1 to 63 bytes, without / and control characters";
                return self.wrong(&worker.name, allowed);
            }
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

    fn cpu(&self, cpu: Option<&Spanned<usize>>, machine: &Machine) -> Found<Option<usize>> {
        match cpu {
            Some(cpu) if !machine.cpus.contains(cpu.get_ref()) => {
                self.wrong(cpu, format!("allowed {:?} (machine.cpus)", machine.cpus))
            }
            other => Ok(other.map(|cpu| *cpu.get_ref())),
        }
    }

    fn worker(
        &self,
        raw: &raw::Worker,
        all: &[raw::Worker],
        machine: &Machine,
        locks: &mut Vec<String>,
    ) -> Found<Described> {
        let scheduling = match (&raw.guarantee, &raw.policy) {
            (Some(_), Some(policy)) => {
                let message = "a worker has either a guarantee or a policy, not both";
                return self.wrong(policy, message);
            }
            (Some(guarantee), None) => Some(Requirement::Guarantee(self.guarantee(guarantee)?)),
            (None, Some(policy)) => Some(Requirement::Policy(self.policy(policy, machine)?)),
            (None, None) => None,
        };
        if let (Some(deadline), Some(_)) = (&raw.deadline, &raw.guarantee) {
            let message = "the deadline of a guaranteed worker belongs into its guarantee";
            return self.wrong(deadline, message);
        }
        let mut sends = Vec::new();
        for to in &raw.sends {
            match all.iter().position(|w| w.name.get_ref() == to.get_ref()) {
                Some(at) => sends.push(at),
                None => return self.wrong(to, format!("there is no worker {:?}", to.get_ref())),
            }
        }
        let lock = |lock: &Spanned<raw::Lock>| {
            let lock = lock.get_ref();
            let known = locks.iter().position(|l| *l == lock.name);
            let at = known.unwrap_or_else(|| {
                locks.push(lock.name.clone());
                locks.len() - 1
            });
            (at, lock.holds.0)
        };
        let queue = match &raw.queue {
            Some(queue) if *queue.get_ref() > 4096 => {
                return self.wrong(queue, "allowed 0 to 4096");
            }
            Some(queue) => *queue.get_ref(),
            None => 1,
        };
        let releases = raw
            .releases
            .as_ref()
            .map(|r| self.releases(r))
            .transpose()?;
        Ok(Described {
            name: raw.name.get_ref().clone(),
            handles: raw.handles.iter().map(|h| h.get_ref().clone()).collect(),
            cpu: self.cpu(raw.cpu.as_ref(), machine)?,
            scheduling,
            load: Load {
                runs: raw.runs.as_ref().map(|t| t.get_ref().0.clone()),
                blocks: raw.blocks.as_ref().map(|t| t.get_ref().0.clone()),
                releases,
                queue,
                overflow: match raw.overflow {
                    Some(raw::Overflow::DropNewest) => Overflow::DropNewest,
                    Some(raw::Overflow::DropOldest) | None => Overflow::DropOldest,
                },
                sends,
                locks: raw.locks.iter().map(lock).collect(),
                deadline: raw.deadline.as_ref().map(|d| d.get_ref().0),
            },
            place: raw.name.span(),
            handle_places: raw.handles.iter().map(Spanned::span).collect(),
        })
    }

    fn executor(
        &self,
        raw: &raw::Executor,
        machine: &Machine,
        workers: &[Described],
    ) -> Found<ExecutorRequest> {
        let cpu = self.cpu(raw.cpu.as_ref(), machine)?;
        if let Some(policy) = &raw.policy {
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

    fn chain(&self, raw: &raw::Chain, workers: &[Described]) -> Found<Chain> {
        let mut stages: Vec<usize> = Vec::new();
        for name in raw.workers.get_ref() {
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
            return self.wrong(&raw.workers, "a chain has at least two workers");
        }
        Ok(Chain {
            name: raw.name.get_ref().clone(),
            workers: stages,
            deadline: raw.deadline.as_ref().map(|d| d.get_ref().0),
        })
    }
}
