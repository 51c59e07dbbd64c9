//! Settings and results of planning, in builds without feature `plan`: there are none.

use crate::platform::Text;
use alloc::string::String;
use alloc::vec::Vec;

/// Nothing can be set about planning.
#[derive(Default)]
pub(crate) struct Planning {}

/// Whether and how guarantees were tested before the start: there are none in this build.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct AdmissionReport {
    /// What limits the guarantees: nothing.
    pub notes: Vec<String>,
}

/// What admission has left behind.
#[derive(Debug, Default)]
pub(crate) struct Admission {
    pub(crate) report: AdmissionReport,
    pub(crate) fallback: Option<Text>,
    pub(crate) place: Option<()>,
}
