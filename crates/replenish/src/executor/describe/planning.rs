//! Settings and results of planning.

use crate::error::Error;
use crate::executor::run::guarantee::adoption::{Adopted, AdoptedReport, Adoption};
use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use replenish_plan::ledger::{Denied, LedgerError, Reservation};
use replenish_plan::{FileError, GuaranteeError, Machine, Plan, Refusal};
use sporadic::WholeUnits;
use std::path::PathBuf;

/// The settings.
pub(crate) struct Planning {
    pub(crate) admission: bool,
    pub(crate) ledger: LedgerUse,
    pub(crate) machine: Option<Machine>,
    pub(crate) overlays: Vec<PathBuf>,
    pub(crate) adopted: Vec<Adopted>,
}

impl Default for Planning {
    fn default() -> Self {
        Self {
            admission: true,
            ledger: LedgerUse::Default,
            machine: None,
            overlays: Vec::new(),
            adopted: Vec::new(),
        }
    }
}

/// The ledger in which the executor reads and keeps reservations.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum LedgerUse {
    /// The ledger that [`Ledger::find`](replenish_plan::ledger::Ledger::find) returns.
    Default,
    /// In this directory.
    At(PathBuf),
    /// Nowhere.
    Off,
}

/// Whether and how guarantees were tested before the start.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct AdmissionReport {
    /// The plan, with reasons; `None` without a guarantee.
    pub plan: Option<Plan>,
    /// The directory of the reservation; `None`: other programs do not see it.
    pub ledger: Option<PathBuf>,
    /// Limits of the guarantees, and files of the ledger that were left out.
    pub notes: Vec<String>,
    /// Threads that others have started, by pattern, in the order in which they were asked for.
    pub adopted: Vec<AdoptedReport>,
}

impl AdmissionReport {
    /// A sentence for each budget that is larger than the user said.
    pub(crate) fn additions(&self) -> impl Iterator<Item = String> + '_ {
        let workers = self.plan.iter().flat_map(|plan| &plan.workers);
        workers.filter_map(|worker| {
            let (asked, params) = worker.amount.zip(worker.policy.params())?;
            let added = params
                .budget()
                .checked_sub(asked)
                .filter(|added| *added > 0)?;
            Some(format!(
                "{}: {} for each callback, and {} for switching and enforcing",
                worker.name,
                WholeUnits(asked),
                WholeUnits(added)
            ))
        })
    }
}

/// The result of admission.
#[derive(Debug, Default)]
pub(crate) struct Admission {
    pub(crate) report: AdmissionReport,
    /// A promise that is not in force, in words.
    pub(crate) fallback: Option<String>,
    /// Given back when the executor ends.
    pub(crate) place: Option<Reservation>,
    /// Holds the budgets of adopted threads.
    pub(crate) adoption: Option<Adoption>,
}

impl Admission {
    /// The report up to this moment.
    pub(crate) fn report(&self) -> AdmissionReport {
        let mut report = self.report.clone();
        report.adopted = self
            .adoption
            .as_ref()
            .map_or_else(Vec::new, Adoption::report);
        report
    }

    /// Gives everything back.
    pub(crate) fn end(&mut self) {
        self.adoption = None;
        self.place = None;
    }
}

impl From<GuaranteeError> for Error {
    fn from(e: GuaranteeError) -> Self {
        Self::Guarantee {
            reason: e.to_string(),
        }
    }
}

impl From<Refusal> for Error {
    fn from(refusal: Refusal) -> Self {
        Self::NotAdmitted {
            reason: refusal.sentence,
        }
    }
}

impl From<LedgerError> for Error {
    fn from(e: LedgerError) -> Self {
        Self::NotAdmitted {
            reason: e.to_string(),
        }
    }
}

impl From<Denied> for Error {
    fn from(e: Denied) -> Self {
        match e {
            Denied::Refused(refusal) => refusal.into(),
            Denied::Ledger(e) => e.into(),
        }
    }
}

impl From<FileError> for Error {
    fn from(e: FileError) -> Self {
        Self::Overlay {
            reason: e.to_string(),
        }
    }
}
