//! In the place of `std/source_set` in builds without feature `std`: workers wait for their bells
//! alone.
#![allow(dead_code, reason = "nobody waits for descriptors")]
#![expect(
    clippy::missing_const_for_fn,
    reason = "the signatures of what it stands in for"
)]

use crate::Nanos;
use crate::handoff::{Doorbell, Woken};
use crate::sync::{Arc, Notify};
use core::convert::Infallible;

/// There is none.
#[derive(Debug)]
pub struct SourceSet(Infallible);

impl SourceSet {
    pub(crate) fn new(_: &Arc<Notify>) -> Option<Arc<Self>> {
        None
    }

    pub(crate) fn handles(&self) -> usize {
        match self.0 {}
    }

    pub(crate) fn join(&self) {
        match self.0 {}
    }

    pub(crate) fn leave(&self) {
        match self.0 {}
    }

    pub(crate) fn sleep<W: ?Sized>(
        &self,
        _: &Doorbell<W>,
        _: Option<Nanos>,
        _: &mut dyn FnMut(usize),
    ) -> Woken {
        match self.0 {}
    }

    pub(crate) fn wait(&self, _: Option<Nanos>, _: &mut dyn FnMut(usize)) {
        match self.0 {}
    }
}
