//! The recordings that count: those of the program, and of every program that runs beside it.

use super::parts::By;
use crate::live::timeline::{Facts, Timeline};
use crate::live::{Program, all};
use replenish_recorder::{NameKind, Role, ThreadView};
use std::rc::Rc;

/// A program's names, by id.
type Names = Vec<Option<(NameKind, String)>>;

/// The recordings that count.
pub(super) struct Recorded {
    pub(super) threads: Vec<Timeline>,
    /// Of each thread, the names of its program.
    names: Vec<Rc<Names>>,
    /// Number of the program's own threads.
    pub(super) own: usize,
}

impl Recorded {
    pub(super) fn name(&self, thread: usize, id: u32) -> String {
        let name = self
            .names
            .get(thread)
            .and_then(|names| names.get(id as usize));
        match name {
            Some(Some((_, name))) => name.clone(),
            _ => format!("#{id}"),
        }
    }

    fn add(&mut self, program: &Program, label: bool) {
        let names = Rc::new(program.view.names(&program.source));
        for thread in &program.view.threads {
            let (mut events, first) = thread.events(&program.source);
            let (budget, second) = thread.budget_events(&program.source);
            if thread.role == Role::Dispatcher {
                events.clear(); // it runs no callbacks
            }
            let overwritten = [first.overwritten > 0, second.overwritten > 0];
            let facts = facts(thread, label.then_some(&*program.view.program));
            let timeline = Timeline::new(facts, &events, &budget, overwritten);
            self.threads.push(timeline);
            self.names.push(Rc::clone(&names));
        }
    }

    /// In words.
    pub(super) fn by(&self, thread: usize, by: By) -> Option<String> {
        Some(match by {
            By::Nobody => return None,
            By::Handle(id) => self.name(thread, id),
            By::Thread(n, id) => {
                let worker = self.threads.get(n).map_or("", |t| &*t.facts.name);
                match id {
                    0 => format!("worker {worker}"),
                    id => format!("{} of worker {worker}", self.name(n, id)),
                }
            }
            By::Unrecorded => "a thread that is not recorded".into(),
            By::Unknown => "it waited, or a thread that is not recorded ran".into(),
            By::After(id) => format!("after {}", self.name(thread, id)),
        })
    }
}

fn facts(thread: &ThreadView, program: Option<&str>) -> Facts {
    let policy = thread.policy.strip_prefix("FIFO ");
    let policy = policy.or_else(|| thread.policy.strip_prefix("RR "));
    let number = policy.and_then(|p| p.split(',').next());
    Facts {
        name: match program {
            Some(program) => format!("{} of program {program}", thread.name),
            None => thread.name.clone(),
        },
        cpu: thread.cpu,
        priority: number.and_then(|n| n.parse().ok()).unwrap_or(0),
        budget: thread.budget,
    }
}

/// The program's threads first, then those of every other program that runs beside it.
pub(super) fn recorded(program: &Program) -> Recorded {
    let mut recorded = Recorded {
        threads: Vec::new(),
        names: Vec::new(),
        own: program.view.threads.len(),
    };
    recorded.add(program, false);
    if program.alive {
        let others = all().programs;
        let others = others.iter().filter(|p| p.alive && p.path != program.path);
        others.for_each(|other| recorded.add(other, true));
    }
    recorded
}
