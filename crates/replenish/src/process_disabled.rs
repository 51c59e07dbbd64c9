//! In the place of `process` without feature `std`: no arguments, no signals.

use crate::chain::ChainReport;
use crate::error::Error;
use crate::event::Events;
use crate::name;
use crate::parameter::{ParameterError, ParameterValue};
use crate::platform::Text;
use crate::platform::chain::Requested;
use crate::platform::recorder::ChainFacts;
use crate::sync::Arc;
use alloc::string::String;
use alloc::vec::Vec;

/// The kind of thing that a name stands for.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Topic,
    Service,
    Action,
}

/// There are none.
#[derive(Default)]
pub(crate) struct Args;

impl Args {
    pub(crate) fn node(&self, _given: &str, full: String) -> Result<String, Error> {
        Ok(full)
    }

    pub(crate) const fn time(&self, _node: &str, _clock: &SimClock) -> NodeTime {
        NodeTime
    }

    pub(crate) fn name(&self, _kind: Kind, given: &str, node: &str) -> Result<String, Error> {
        Ok(name::topic(given, node)?)
    }

    pub(crate) fn declared<R>(
        &self,
        _node: &str,
        _name: &str,
        (value, _): (ParameterValue<'_>, bool),
        then: impl FnOnce(ParameterValue<'_>) -> Result<R, ParameterError>,
    ) -> Result<R, ParameterError> {
        then(value)
    }
}

/// There is no simulation.
#[derive(Default)]
pub(crate) struct SimClock;

/// There are no loggers.
#[derive(Default)]
pub(crate) struct Loggers;

impl Loggers {
    pub(crate) const fn flush(&self) {}
}

/// No chain is measured.
#[derive(Default)]
pub(crate) struct Chains;

impl Chains {
    pub(crate) const fn report(&self) -> Vec<ChainReport> {
        Vec::new()
    }

    pub(crate) const fn facts(&self) -> [ChainFacts; 0] {
        []
    }
}

#[expect(
    clippy::unnecessary_wraps,
    reason = "the signature of what it stands in for"
)]
pub(crate) fn start_chains<W>(_: &Requested, _: &mut [W]) -> Result<Chains, Error> {
    Ok(Chains)
}

/// There are no diagnostics.
#[derive(Default)]
pub(crate) struct DiagnosticsChoice;

/// Without ROS arguments no setting depends on the first node.
#[derive(Default)]
pub(crate) struct FirstNode;

impl FirstNode {
    pub(crate) const fn note(&self, _name: &str) {}
}

/// Nothing is published.
pub(crate) struct Diagnostics {
    pub(crate) fallback: Option<Text>,
}

impl Diagnostics {
    pub(crate) const fn start<C, P, L, H>(
        _context: &C,
        _choice: &DiagnosticsChoice,
        _plans: &[P],
        _live: &L,
        _chains: &H,
        _events: &Arc<Events>,
    ) -> Self {
        Self { fallback: None }
    }

    pub(crate) const fn end(&mut self) {}
}

/// The time of the machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeTime;

/// Its endpoints alone say that a node is there.
#[derive(Clone, Debug)]
pub(crate) struct Presence;

impl Presence {
    #[expect(
        clippy::unnecessary_wraps,
        reason = "the signature of what it stands in for"
    )]
    pub(crate) const fn of<M, N>(_middleware: &M, _node: &N) -> Result<Self, Error> {
        Ok(Self)
    }
}

/// Without simulated time there is no clock to follow.
pub(crate) const fn follow_clock<E>(_executor: &mut E) -> Result<(), Error> {
    Ok(())
}

/// Nothing ends by signals.
#[derive(Clone, Default)]
pub(crate) struct Ends;

impl Ends {
    pub(crate) const fn watch<S>(&self, _stop: &S) -> Watched {
        Watched
    }
}

/// Nothing is watched.
#[derive(Debug)]
pub(crate) struct Watched;

/// There is nothing to import.
pub(crate) mod prelude {}

/// Users see nothing of it.
pub(crate) mod public {}
