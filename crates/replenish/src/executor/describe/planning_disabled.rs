//! Settings and results of planning, in builds without feature `plan`: there are none.

use crate::platform::Text;
use alloc::string::String;
use alloc::vec::Vec;

/// This build has no settings of planning.
#[derive(Default)]
pub(crate) struct Planning {}

/// Whether and how guarantees were tested before the start: there are none in this build.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct AdmissionReport {
    /// Limits of the guarantees: none.
    pub notes: Vec<String>,
}

impl AdmissionReport {
    /// This build adds nothing to budgets.
    pub(crate) fn additions(&self) -> impl Iterator<Item = String> + '_ {
        core::iter::empty()
    }
}

/// The results of admission.
#[derive(Debug, Default)]
pub(crate) struct Admission {
    pub(crate) report: AdmissionReport,
    pub(crate) fallback: Option<Text>,
}

impl Admission {
    /// The report.
    pub(crate) fn report(&self) -> AdmissionReport {
        self.report.clone()
    }

    /// This build has no reservations to give back.
    pub(crate) fn end(&mut self) {}
}
