//! The deployment file's word about a budget.
//!
//! `REPLENISH_OVERLAY` names the file, and a `[[worker]]` of it overrides the budget of that name.
//!
//! Handles and sections for other readers have no meaning here. A worker that lists handles is an
//! error, because no thread here has any.

use crate::asked::Asked;
use crate::failure::{Failure, Why};
use replenish_os::SchedClass;
use replenish_plan::file::Described;
use replenish_plan::{Deployment, Requirement};
use sporadic::{Low, Policy};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Names the file, as for our own executor.
const VARIABLE: &str = "REPLENISH_OVERLAY";

/// Request of the program, and the file's changes to it.
pub(crate) fn apply(asked: Asked) -> Result<Asked, Failure> {
    match file()? {
        Some(file) => over(file, asked),
        None => Ok(asked),
    }
}

/// The file, read once.
///
/// # Errors
/// It cannot be read or makes no sense.
pub(crate) fn file() -> Result<Option<&'static Deployment>, Failure> {
    static FILE: OnceLock<Result<Option<Deployment>, Failure>> = OnceLock::new();
    let read = || {
        let path = std::env::var_os(VARIABLE).filter(|path| !path.is_empty());
        path.map(|path| read(&PathBuf::from(path))).transpose()
    };
    FILE.get_or_init(read)
        .as_ref()
        .map(Option::as_ref)
        .map_err(Clone::clone)
}

fn read(path: &Path) -> Result<Deployment, Failure> {
    let wrong = |e| Failure::invalid(format!("{VARIABLE}: {e}"));
    let file = Deployment::read(path).map_err(wrong)?;
    let lists = |worker: &Described| !worker.handles.is_empty();
    if let Some(worker) = file.workers.iter().position(lists) {
        let text = "its handles: budgets of threads have none; the name alone says which is meant";
        return Err(wrong(file.error_at_worker(worker, text)));
    }
    Ok(file)
}

fn over(file: &Deployment, mut asked: Asked) -> Result<Asked, Failure> {
    let mut workers = file.workers.iter().enumerate();
    let Some((at, described)) = workers.find(|(_, worker)| worker.name == asked.name) else {
        return Ok(asked);
    };
    let cannot = |text: &str| {
        let error = file.error_at_worker(at, text);
        Err(Failure::new(
            Why::Unsupported,
            format!("{VARIABLE}: {error}"),
        ))
    };
    match &described.scheduling {
        None => {}
        Some(Requirement::Guarantee(guarantee)) if guarantee.budget().suspend => {
            return cannot("its guarantee: a thread of foreign code cannot be suspended");
        }
        Some(Requirement::Policy(Policy::Sporadic(params))) => match params.low() {
            Low::Suspend => {
                return cannot("its policy: a thread of foreign code cannot be suspended");
            }
            Low::Background(0) => {}
            Low::Background(low) => asked.background = SchedClass::Fifo(low),
        },
        Some(Requirement::Policy(_)) => {
            return cannot("its policy: allowed here are a guarantee, or kind = \"sporadic\"");
        }
        Some(Requirement::Guarantee(_)) => {}
    }
    asked.scheduling = described.scheduling.clone().or(asked.scheduling);
    asked.cpu = described.cpu.or(asked.cpu);
    Ok(asked)
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_plan::Guarantee;
    use std::time::Duration;

    fn asked(name: &str) -> Asked {
        let ms = Duration::from_millis;
        let guarantee = Guarantee::of(ms(30)).every(ms(100));
        Asked {
            name: name.into(),
            scheduling: Some(Requirement::Guarantee(guarantee)),
            cpu: None,
            background: SchedClass::Other,
        }
    }

    fn applied(text: &str, name: &str) -> Result<Asked, Failure> {
        let path = std::env::temp_dir().join(format!(
            "replenish-threads-{}-{name}.toml",
            std::process::id()
        ));
        std::fs::write(&path, text).unwrap();
        let file = read(&path);
        std::fs::remove_file(&path).unwrap();
        over(&file?, asked(name))
    }

    #[test]
    fn the_file_overrides_the_budget_of_its_name_alone() {
        let file = "[[worker]]\nname = \"control\"\ncpu = 1\n\
                    guarantee = { budget = \"10 ms\", period = \"50 ms\" }\n";
        let control = applied(file, "control").unwrap();
        let ms = Duration::from_millis;
        let wanted = Guarantee::of(ms(10)).every(ms(50));
        assert_eq!(control.scheduling, Some(Requirement::Guarantee(wanted)));
        assert_eq!(control.cpu, Some(1));
        assert_eq!(applied(file, "other").unwrap(), asked("other"));
    }

    #[test]
    fn an_experts_background_is_the_files() {
        let file = "[[worker]]\nname = \"expert\"\npolicy = { kind = \"sporadic\", priority = 60, \
                    background = 10, budget = \"1 ms\", period = \"10 ms\" }\n";
        let expert = applied(file, "expert").unwrap();
        assert_eq!(expert.background, SchedClass::Fifo(10));
        let Some(Requirement::Policy(policy)) = expert.scheduling else {
            panic!("{expert:?}");
        };
        assert_eq!(policy.params().unwrap().priority(), 60);
    }

    #[test]
    fn a_file_that_cannot_be_meant_is_an_error_with_its_line() {
        let worker = "[[worker]]\nname = \"x\"\n";
        let each = [
            ("handles = [\"a\"]\n", "handles"),
            ("policy = { kind = \"fifo\", priority = 3 }\n", "sporadic"),
            (
                "guarantee = { budget = \"1 ms\", period = \"9 ms\", suspend = true }\n",
                "suspended",
            ),
            (
                "policy = { kind = \"sporadic\", priority = 3, suspend = true, budget = \"1 ms\", \
                 period = \"9 ms\" }\n",
                "suspended",
            ),
        ];
        for (line, word) in each {
            let failure = applied(&format!("{worker}{line}"), "x").unwrap_err();
            assert!(failure.text.contains(word), "{failure}");
            assert!(failure.text.contains(VARIABLE), "{failure}");
        }
    }
}
