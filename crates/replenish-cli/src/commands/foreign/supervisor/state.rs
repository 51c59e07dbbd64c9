//! A supervisor: its budgets, and the programs, processes and threads that it knows.

use crate::commands::foreign::admission::admit;
use crate::commands::foreign::budgets::Budgets;
use crate::commands::foreign::cgroup::Cgroup;
use crate::commands::foreign::control::Control;
use crate::commands::foreign::figures::Figures;
use crate::commands::foreign::guardian::Guardian;
use crate::commands::foreign::rules::{Background, Terms};
use crate::commands::foreign::selection::Selection;
use crate::outcome::Failure;
use crate::time::Nanos;
use replenish_os::foreign::{ForeignThread, Original};
use replenish_os::{SchedClass, Tid, privilege};
use replenish_plan::ledger::Reservation;
use std::collections::BTreeMap;
use std::time::Duration;

/// Between two looks.
pub(crate) const PAUSE: Duration = Duration::from_millis(20);
/// Budgets, and the programs that have them.
#[derive(Debug)]
pub(crate) struct Supervisor {
    pub(super) budgets: Budgets,
    pub(super) guardian: Guardian,
    /// Where threads are stopped, if any are to be.
    pub(super) cgroup: Option<Cgroup>,
    pub(super) control: Control,
    pub(super) figures: Figures,
    pub(super) roots: BTreeMap<Tid, Root>,
    pub(super) processes: BTreeMap<Tid, Process>,
    pub(super) threads: BTreeMap<Tid, Known>,
    pub(super) looks: u64,
    /// Given back last, when the threads have what they had.
    _reservation: Option<Reservation>,
}

#[derive(Debug)]
pub(super) struct Root {
    pub(super) start: u64,
    pub(super) name: String,
}

#[derive(Debug)]
pub(super) struct Process {
    pub(super) root: Tid,
    /// The original policy and CPUs of the process's first thread.
    pub(super) first: Original,
}

#[derive(Debug)]
pub(super) struct Known {
    pub(super) name: String,
    pub(super) since: Nanos,
    pub(super) rule: Option<usize>,
    pub(super) original: Original,
    pub(super) seen: u64,
}

impl Supervisor {
    /// Admits the budgets; starts the enforcer and the guardian.
    pub(crate) fn start(selection: &Selection, usual: Background) -> Result<Self, Failure> {
        let admission = admit(selection, usual)?;
        let idle = |terms: &Terms| terms.background.class() == SchedClass::Idle;
        let suspend = |terms: &Terms| terms.background == Background::Suspend;
        let suspended = admission.terms.iter().any(suspend);
        if admission.terms.iter().any(idle) && !privilege::probe().cap_sys_nice {
            return Err(Failure::refused(
                "a thread comes back from `--background idle` only by CAP_SYS_NICE, which this \
                 process has not: give --background other, or the capability (replenish doctor)",
            ));
        }
        let mut figures = Figures::start();
        admission
            .notes
            .into_iter()
            .for_each(|why| figures.note(why));
        let mut guardian = Guardian::start(admission.cpu)?;
        let cgroup = suspended.then(Cgroup::create).transpose()?;
        let budgets = Budgets::start(admission.terms, admission.cpu)?;
        if let Some(cgroup) = &cgroup {
            guardian.cgroup(&cgroup.homes.base)?;
            budgets.suspend_in(cgroup)?;
        }
        Ok(Self {
            budgets,
            guardian,
            cgroup,
            _reservation: admission.reservation,
            control: Control::start()?,
            figures,
            roots: BTreeMap::new(),
            processes: BTreeMap::new(),
            threads: BTreeMap::new(),
            looks: 0,
        })
    }

    /// The CPU of all budgets.
    pub(crate) fn cpu(&self) -> usize {
        self.budgets.enforcer.cpu()
    }

    /// The guardian's process.
    pub(crate) fn guardian(&self) -> u32 {
        self.guardian.pid()
    }

    pub(super) fn original(&self, thread: &ForeignThread, first: Option<&Original>) -> Original {
        let has = *thread.original();
        first.map_or(has, |first| has.without_inheritance(self.cpu(), first))
    }
}
