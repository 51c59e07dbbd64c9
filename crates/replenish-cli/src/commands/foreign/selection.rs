//! The budgets that a command is about: those of its command line, or a `[[program]]` of a
//! deployment file.

use super::options::Options;
use super::rules::Asked;
use crate::machine::cpus;
use crate::outcome::Failure;
use replenish_os::Tid;
use replenish_os::foreign::{command_line, fits, name, processes};
use replenish_plan::Deployment;
use replenish_plan::file::{Program, ProgramThread};

/// Budgets to be admitted.
#[derive(Debug)]
pub(crate) struct Selection {
    /// The program, for messages and for the ledger.
    pub(super) name: String,
    pub(super) asked: Vec<Asked>,
    /// Their CPU.
    pub(super) cpu: usize,
    /// The pattern of the processes, from a file.
    pattern: Option<String>,
}

impl Selection {
    /// For a program that is to be started with these arguments.
    pub(crate) fn for_command(options: &Options, command: &[String]) -> Result<Self, Failure> {
        let line = command.join(" ");
        let first = command.first().map_or("", String::as_str);
        let short = first.rsplit('/').next().unwrap_or(first);
        Self::of(options, &line, |pattern| {
            fits(pattern, short) || fits(pattern, &line)
        })
    }

    /// For processes that run already. Returns the processes as well: those that were named, else
    /// all that the file's program is about.
    pub(crate) fn for_processes(
        options: &Options,
        pids: &[Tid],
    ) -> Result<(Self, Vec<Tid>), Failure> {
        let label = pids.first().map_or_else(String::new, |pid| {
            format!("process {pid} ({})", name(*pid).unwrap_or_default())
        });
        let any = pids.is_empty() && options.described.is_none();
        let selection = Self::of(options, &label, |pattern| {
            any || pids.first().is_some_and(|pid| is_about(pattern, *pid))
        })?;
        let Some(pattern) = &selection.pattern else {
            return Ok((selection, pids.to_vec()));
        };
        if !pids.is_empty() {
            return Ok((selection, pids.to_vec()));
        }
        let me = std::process::id().cast_signed();
        let found = processes().into_iter();
        let found: Vec<Tid> = found
            .filter(|pid| pid.get() != me && is_about(pattern, *pid))
            .collect();
        if found.is_empty() {
            return Err(Failure::refused(format!(
                "no process fits {pattern:?}, the match of program {:?}",
                selection.name
            )));
        }
        Ok((selection, found))
    }

    /// `fits_it`: whether a program's pattern is about the subject, which `label` names.
    fn of(options: &Options, label: &str, fits_it: impl Fn(&str) -> bool) -> Result<Self, Failure> {
        let allowed = cpus::allowed();
        let Some(path) = &options.deployment else {
            return Ok(Self {
                name: label.into(),
                asked: options.asked()?,
                cpu: options.cpu.or(allowed.last().copied()).unwrap_or(0),
                pattern: None,
            });
        };
        let file = Deployment::read(path).map_err(Failure::refused)?;
        let wanted = |program: &&Program| match &options.described {
            Some(name) => program.name == *name,
            None => fits_it(&program.pattern),
        };
        let Some(program) = file.programs.iter().find(wanted) else {
            let there = file
                .programs
                .iter()
                .map(|p| format!("{:?} (match {:?})", p.name, p.pattern));
            let there: Vec<String> = there.collect();
            let subject = options.described.as_deref().unwrap_or(label);
            return Err(Failure::refused(format!(
                "{}: no [[program]] is for {subject:?}; there are: {}",
                path.display(),
                if there.is_empty() {
                    "none".into()
                } else {
                    there.join(", ")
                }
            )));
        };
        let asked = |thread: &ProgramThread| Asked {
            pattern: thread.pattern.clone(),
            scheduling: thread.scheduling.clone(),
        };
        Ok(Self {
            name: program.name.clone(),
            asked: program.threads.iter().map(asked).collect(),
            cpu: options.cpu.unwrap_or_else(|| program.place(&allowed)),
            pattern: Some(program.pattern.clone()),
        })
    }
}

/// Whether a pattern fits the name of a process, or its command line.
fn is_about(pattern: &str, pid: Tid) -> bool {
    name(pid).is_some_and(|name| fits(pattern, &name))
        || command_line(pid).is_some_and(|line| fits(pattern, &line))
}
