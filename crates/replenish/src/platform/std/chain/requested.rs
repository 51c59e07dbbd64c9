//! Chains before the start.

use crate::Nanos;
use std::string::String;
use std::vec::Vec;

/// The chains that were asked for.
#[derive(Debug, Default)]
pub(crate) struct Requested(pub(crate) Vec<RequestedChain>);

/// One requested chain.
#[derive(Debug)]
pub(crate) struct RequestedChain {
    pub(crate) name: String,
    /// Handles by id, workers by name.
    pub(crate) stages: Vec<String>,
    pub(crate) limit: Option<Nanos>,
    /// The analysed bound.
    pub(crate) bound: Option<Nanos>,
    /// The executor does not start where the plan allows more than the limit.
    #[allow(dead_code, reason = "read by builds with feature `plan`")]
    pub(crate) is_promised: bool,
}

impl Requested {
    /// The chain that was added last is guaranteed.
    #[allow(dead_code, reason = "named by builds with feature `plan`")]
    pub(crate) fn promise(&mut self) {
        if let Some(chain) = self.0.last_mut() {
            chain.is_promised = true;
        }
    }

    /// Adds a chain; one of the same name is replaced.
    pub(crate) fn add(
        &mut self,
        name: &str,
        stages: Vec<String>,
        limit: Option<Nanos>,
        bound: Option<Nanos>,
    ) {
        self.0.retain(|chain| chain.name != name);
        self.0.push(RequestedChain {
            name: name.into(),
            stages,
            limit,
            bound,
            is_promised: false,
        });
    }
}
