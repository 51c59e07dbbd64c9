//! Settings and results of planning.

use alloc::string::String;
use alloc::vec::Vec;
use replenish_plan::ledger::Reservation;
use replenish_plan::{Machine, Plan};
use std::path::PathBuf;

/// The settings.
pub(crate) struct Planning {
    pub(crate) admission: bool,
    pub(crate) ledger: LedgerUse,
    pub(crate) machine: Option<Machine>,
    pub(crate) overlays: Vec<PathBuf>,
}

impl Default for Planning {
    fn default() -> Self {
        Self {
            admission: true,
            ledger: LedgerUse::Default,
            machine: None,
            overlays: Vec::new(),
        }
    }
}

/// Where reservations are looked up and kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum LedgerUse {
    /// As [`Ledger::find`](replenish_plan::ledger::Ledger::find) says.
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
}

/// The result of admission.
#[derive(Debug, Default)]
pub(crate) struct Admission {
    pub(crate) report: AdmissionReport,
    /// A promise that is not in force, in words.
    pub(crate) fallback: Option<String>,
    /// Given back when the executor ends.
    pub(crate) place: Option<Reservation>,
}
