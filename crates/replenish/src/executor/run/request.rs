//! The scheduling that a program asks for a worker.

use super::guarantee::Guarantee;
use crate::platform::{Text, text};
use crate::sync::Arc;
use replenish_os::Policy;
use sporadic::Budget;

/// The request for one worker.
#[derive(Debug, Clone)]
pub(crate) struct WorkerRequest {
    pub(crate) name: Arc<str>,
    pub(crate) policy: Option<Policy>,
    pub(crate) budget: Option<Budget>,
    pub(crate) guarantee: Option<Guarantee>,
    pub(crate) cpu: Option<usize>,
    pub(crate) stack_size: Option<usize>,
}

impl WorkerRequest {
    /// A request that states nothing but the name.
    pub(crate) fn named(name: &str) -> Self {
        Self {
            name: name.into(),
            policy: None,
            budget: None,
            guarantee: None,
            cpu: None,
            stack_size: None,
        }
    }

    pub(crate) fn owner(&self) -> Text {
        text!("worker {:?}", self.name)
    }
}
