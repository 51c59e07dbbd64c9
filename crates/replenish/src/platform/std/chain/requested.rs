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
}

impl Requested {
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
        });
    }
}
