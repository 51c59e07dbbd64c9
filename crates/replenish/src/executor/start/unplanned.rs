//! In the place of planning, for builds without feature `plan`: workers have the policies and
//! budgets they were given, and nobody checks whether they fit.

use crate::error::Error;
use crate::executor::describe::builder::WorkerSpec;
use crate::executor::{Executor, Options};
use crate::platform::{Static, Text};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use sporadic::Budget;

/// Nothing can be set about planning.
#[derive(Default)]
pub(crate) struct Planning {}

/// There are no guarantees.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Guarantee {}

impl Guarantee {
    pub(crate) const fn budget(&self) -> Budget {
        match *self {}
    }
}

impl fmt::Display for Guarantee {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

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

/// Nothing to plan.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the signature of what it stands in for"
)]
pub(crate) fn admit(_: &mut [Static<WorkerSpec>], _: &mut Options) -> Result<Admission, Error> {
    Ok(Admission::default())
}

/// No deployment files.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the signature of what it stands in for"
)]
pub(crate) fn prepare(_: &mut Executor) -> Result<String, Error> {
    Ok(String::new())
}
