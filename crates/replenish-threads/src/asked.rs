//! A budget as the program asks for it.

use replenish_os::SchedClass;
use replenish_plan::Requirement;

/// A budget that is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Names it in reports, refusals and the deployment file.
    pub name: String,
    /// A guarantee, or an expert's sporadic policy. `None`: only the deployment file says.
    pub scheduling: Option<Requirement>,
    /// The CPU of its threads; `None`: the plan chooses.
    pub cpu: Option<usize>,
    /// Its threads without budget.
    pub background: SchedClass,
}
