//! A deployment file over what the program says: scheduling by stable ids, without a rebuild.
//!
//! - A `[[worker]]` whose name the program has sets or overrides that worker's scheduling.
//! - The handles it lists run on it, in that order, wherever the program had put them. A name the
//!   program does not have makes a new worker for the handles it lists.
//! - Without handles, a name as the kernel shows it, cut after 15 bytes, means the one worker whose
//!   name begins like this: `replenish suggest` knows no other name of threads without recording.
//! - A handle that the program does not have is an error with line and column.
//!
//! And the other way round: the file that describes the program as it is.

use crate::error::Error;
use crate::executor::describe::executor::Executor;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::run::request::WorkerRequest;
use crate::executor::run::rounds::BY_RULES;
use crate::executor::run::state::WorkerSpec;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use replenish_os::Policy;
use replenish_plan::file::Described;
use replenish_plan::{Deployment, ExecutorRequest, Requirement, Template, TemplateWorker};
use std::path::{Path, PathBuf};

/// Names a deployment file that is applied last.
pub(crate) const VARIABLE: &str = "REPLENISH_OVERLAY";

/// Names a file that gets the description of the executor, which does not start then.
const TEMPLATE: &str = "REPLENISH_TEMPLATE";

/// Bytes of a thread's name that the kernel keeps.
const KEPT: usize = 15;

/// Applies the files that were named in the program and in the environment.
pub(crate) fn apply_all(executor: &mut Executor) -> Result<(), Error> {
    let mut files = core::mem::take(&mut executor.options.planning.overlays);
    let named = std::env::var_os(VARIABLE).filter(|v| !v.is_empty());
    files.extend(named.map(PathBuf::from));
    for file in &files {
        apply(executor, file)?;
    }
    Ok(())
}

fn apply(executor: &mut Executor, path: &Path) -> Result<(), Error> {
    let wrong = |e: replenish_plan::FileError| Error::Overlay {
        reason: e.to_string(),
    };
    let file = Deployment::read(path).map_err(wrong)?;
    let had_handles: Vec<String> = executor
        .workers
        .iter()
        .filter(|w| !w.entries.is_empty())
        .map(|w| String::from(&*w.request.name))
        .collect();
    let mut names = Vec::with_capacity(file.workers.len());
    for (index, described) in file.workers.iter().enumerate() {
        let mut moved = Vec::with_capacity(described.handles.len());
        for (place, id) in described.handles.iter().enumerate() {
            match take(&mut executor.workers, id) {
                Some(entry) => moved.push(entry),
                None => {
                    let has = ids(&executor.workers, &moved);
                    let message = alloc::format!("this program has no handle {id:?}; it has {has}");
                    return Err(wrong(file.error_at_handle(index, place, &message)));
                }
            }
        }
        let known = executor
            .workers
            .iter()
            .position(|w| *w.request.name == *described.name);
        let cut = match moved.as_slice() {
            [] => by_cut_name(&executor.workers, &described.name),
            _ => Ok(None),
        };
        let cut = cut.map_err(|message| wrong(file.error_at_worker(index, &message)));
        let at = match known.map_or(cut, |at| Ok(Some(at)))? {
            Some(at) => at,
            None if moved.is_empty() => {
                let names: Vec<_> = executor.workers.iter().map(|w| &*w.request.name).collect();
                let message = alloc::format!(
                    "this program has no worker {:?}, and no handles are listed for a new one; it has {}",
                    described.name,
                    names.join(", ")
                );
                return Err(wrong(file.error_at_worker(index, &message)));
            }
            None => {
                executor.workers.push(WorkerSpec::new(&described.name));
                executor.workers.len() - 1
            }
        };
        if let Some(spec) = executor.workers.get_mut(at) {
            names.push(String::from(&*spec.request.name));
            moved.append(&mut spec.entries);
            spec.entries = moved;
            if spec.entries.iter().any(|entry| entry.handling.always) {
                spec.rules.rounds.get_or_insert(&BY_RULES);
            }
            schedule(&mut spec.request, described);
        }
    }
    chains(executor, &file, &names);
    let emptied = |w: &WorkerSpec| {
        w.entries.is_empty() && had_handles.iter().any(|name| **name == *w.request.name)
    };
    executor.workers.retain(|w| !emptied(w));
    if let ExecutorRequest::Policy { policy, cpu } = &file.executor {
        executor.options.dispatcher = Some(*policy);
        executor.options.dispatcher_cpu = *cpu;
    }
    if file.machine_given {
        executor.options.planning.machine = Some(file.machine.clone());
    }
    Ok(())
}

/// The file's chains are measured, each beside the bound that the file's plan has for it. `names`:
/// of its workers, as the program has them.
fn chains(executor: &mut Executor, file: &Deployment, names: &[String]) {
    if file.chains.is_empty() {
        return;
    }
    let plan = match file.plan() {
        Ok(plan) => Some(plan),
        Err(refusal) => refusal.attempt.map(|attempt| *attempt),
    };
    for (at, chain) in file.chains.iter().enumerate() {
        let places = chain.workers.iter().enumerate();
        let stages = places.filter_map(|(place, worker)| {
            let name = names.get(*worker)?;
            let samples = place > 0 && file.is_periodic(*worker);
            let timer = if samples { timer(executor, name) } else { None };
            Some(timer.unwrap_or_else(|| name.clone()))
        });
        let stages = stages.collect();
        let planned = plan.as_ref().and_then(|plan| plan.chains.get(at));
        let bound = planned.and_then(|planned| planned.worst);
        let chains = &mut executor.options.chains;
        chains.add(&chain.name, stages, chain.deadline, bound);
    }
}

/// The timer of a worker that has one: where the worker takes the latest input by itself.
fn timer(executor: &Executor, worker: &str) -> Option<String> {
    let worker = executor
        .workers
        .iter()
        .find(|w| *w.request.name == *worker)?;
    let mut timers = worker.entries.iter().filter(|e| e.shared.input.is_none());
    let timer = timers.next().filter(|_| timers.next().is_none())?;
    Some(timer.shared.id.clone())
}

/// The worker whose name the kernel cuts to `name`.
///
/// # Errors
/// The sentence about several such workers.
fn by_cut_name(workers: &[WorkerSpec], name: &str) -> Result<Option<usize>, String> {
    let cut = |w: &&WorkerSpec| w.request.name.len() > KEPT && shown(&w.request.name) == name;
    let meant: Vec<&str> = workers
        .iter()
        .filter(cut)
        .map(|w| &*w.request.name)
        .collect();
    match meant.as_slice() {
        [] => Ok(None),
        [one] => Ok(workers.iter().position(|w| *w.request.name == **one)),
        several => Err(alloc::format!(
            "the name {name:?} is cut after {KEPT} bytes and may be any of {}; write the whole name",
            several.join(", ")
        )),
    }
}

/// A name as the kernel shows it: no more than [`KEPT`] bytes, and no half of a character.
fn shown(name: &str) -> &str {
    let end = (0..=KEPT).rev().find(|end| name.is_char_boundary(*end));
    name.get(..end.unwrap_or(0)).unwrap_or(name)
}

fn schedule(request: &mut WorkerRequest, described: &Described) {
    match &described.scheduling {
        None => {}
        Some(Requirement::Guarantee(guarantee)) => {
            request.policy = None;
            request.budget = None;
            request.guarantee = Some(*guarantee);
        }
        Some(Requirement::Policy(policy)) => {
            request.policy = Some(*policy);
            request.budget = None;
            request.guarantee = None;
        }
    }
    request.cpu = described.cpu.or(request.cpu);
}

fn take(workers: &mut [WorkerSpec], id: &str) -> Option<HandleEntry> {
    workers.iter_mut().find_map(|worker| {
        let at = worker.entries.iter().position(|e| e.shared.id == id)?;
        Some(worker.entries.remove(at))
    })
}

fn ids(workers: &[WorkerSpec], moved: &[HandleEntry]) -> String {
    let entries = workers.iter().flat_map(|w| &w.entries).chain(moved);
    let ids: Vec<&str> = entries.map(|e| &*e.shared.id).collect();
    if ids.is_empty() {
        "none".to_string()
    } else {
        ids.join(", ")
    }
}

/// Writes the template where [`TEMPLATE`] says, and refuses to start then: the program is asked for
/// its description, and a robot should not move for that.
pub(crate) fn hand_out(template: &str) -> Result<(), Error> {
    let Some(path) = std::env::var_os(TEMPLATE).filter(|v| !v.is_empty()) else {
        return Ok(());
    };
    let path = PathBuf::from(path);
    let done = match std::fs::write(&path, template) {
        Ok(()) => "written; nothing was started".to_string(),
        Err(e) => e.to_string(),
    };
    Err(Error::Overlay {
        reason: alloc::format!("{TEMPLATE}, {}: {done}", path.display()),
    })
}

/// The file that describes these workers as they are.
pub(crate) fn template(workers: &[WorkerSpec]) -> String {
    let worker = |spec: &WorkerSpec| TemplateWorker {
        name: String::from(&*spec.request.name),
        handles: spec.entries.iter().map(|e| e.shared.id.clone()).collect(),
        cpu: spec.request.cpu,
        guarantee: spec.request.wants(),
        policy: spec.request.policy.filter(|p| *p != Policy::Other),
        ..TemplateWorker::default()
    };
    let header = [
        "Scheduling of a running program, as it says itself. Change what should be different, remove",
        "the rest, and start the program with REPLENISH_OVERLAY=<this file>.",
        "A worker may have a guarantee { budget, period, deadline?, importance?, minimum?, desired? }",
        "or { rate, takes, … }, or a policy, or nothing: then it is time-shared.",
    ];
    let template = Template {
        header: header.map(String::from).to_vec(),
        machine: None,
        workers: workers.iter().map(worker).collect(),
    };
    template.to_string()
}
