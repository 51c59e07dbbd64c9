//! The start in builds without feature `plan`: workers have the policies and budgets that they were
//! given. No test says whether they fit.

use super::running::StartedThread;
use crate::error::Error;
use crate::executor::describe::executor::{Executor, Options};
use crate::executor::describe::planning::Admission;
use crate::executor::run::state::WorkerSpec;
use crate::platform::Static;
use alloc::string::String;

/// This build plans nothing.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the signature of what it stands in for"
)]
pub(crate) fn admit(_: &mut [Static<WorkerSpec>], _: &mut Options) -> Result<Admission, Error> {
    Ok(Admission::default())
}

/// This build reads no deployment files.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the signature of what it stands in for"
)]
pub(crate) fn prepare(_: &mut Executor) -> Result<String, Error> {
    Ok(String::new())
}

/// There are no threads to adopt.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the signature of what it stands in for"
)]
pub(crate) fn adopt(_: &mut Admission, _: &Options, _: &[StartedThread]) -> Result<(), Error> {
    Ok(())
}
