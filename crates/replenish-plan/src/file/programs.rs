//! Reading of the programs of a file.

use super::parse::{Found, Parser};
use super::program::{Program, ProgramThread};
use super::schema;
use crate::{Machine, Requirement};
use sporadic::Policy;

/// More programs of a file, and more budgets of one program, are refused.
const MOST: usize = 64;
/// The longest pattern, in bytes.
const LONGEST: usize = 200;

impl Parser<'_> {
    pub(super) fn programs(
        &self,
        written: &[schema::Program],
        machine: &Machine,
    ) -> Found<Vec<Program>> {
        if let Some(one) = written.get(MOST) {
            return self.wrong(&one.name, format!("allowed up to {MOST} programs"));
        }
        let mut programs: Vec<Program> = Vec::with_capacity(written.len());
        for one in written {
            self.name(&one.name)?;
            let name = one.name.get_ref().clone();
            if programs.iter().any(|other| other.name == name) {
                return self.wrong(&one.name, format!("there is a program {name:?} already"));
            }
            let mut threads: Vec<ProgramThread> = Vec::with_capacity(one.thread.len());
            for thread in &one.thread {
                let next = self.thread(thread, machine)?;
                if threads.iter().any(|other| other.pattern == next.pattern) {
                    return self.wrong(&thread.pattern, "each pattern of a program once");
                }
                threads.push(next);
            }
            if !(1..=MOST).contains(&threads.len()) {
                let allowed = format!("a program needs 1 to {MOST} [[program.thread]]");
                return self.wrong(&one.name, allowed);
            }
            programs.push(Program {
                name,
                pattern: self.pattern(&one.pattern)?,
                cpu: self.cpu(one.cpu.as_ref(), machine)?,
                threads,
                place: one.name.span(),
            });
        }
        Ok(programs)
    }

    fn thread(&self, written: &schema::ProgramThread, machine: &Machine) -> Found<ProgramThread> {
        let scheduling = match (&written.guarantee, &written.policy) {
            (Some(guarantee), None) => Requirement::Guarantee(self.guarantee(guarantee)?),
            (None, Some(at)) => match self.policy(at, machine)? {
                policy @ Policy::Sporadic(_) => Requirement::Policy(policy),
                _ => {
                    let allowed = "threads of a program get a policy of kind \"sporadic\"";
                    return self.wrong(at, allowed);
                }
            },
            _ => {
                let allowed = "threads of a program get either a guarantee or a policy";
                return self.wrong(&written.pattern, allowed);
            }
        };
        Ok(ProgramThread {
            pattern: self.pattern(&written.pattern)?,
            scheduling,
        })
    }

    fn pattern(&self, written: &toml::Spanned<String>) -> Found<String> {
        let pattern = written.get_ref();
        if pattern.is_empty() || pattern.len() > LONGEST || pattern.contains(char::is_control) {
            let allowed = format!("a pattern has 1 to {LONGEST} bytes without control characters");
            return self.wrong(written, allowed);
        }
        Ok(pattern.clone())
    }
}
