//! In the place of `std/local` in builds without feature `std`: every reader gets bytes.
#![allow(dead_code, reason = "nobody delivers")]
#![expect(
    clippy::extra_unused_type_parameters,
    clippy::missing_const_for_fn,
    clippy::unused_self,
    reason = "the signatures of what it stands in for"
)]

use crate::handoff::{DeliveryOutcome, Doorbell, SampleInfo, Shared};
use crate::sync::Arc;
use core::convert::Infallible;
use core::fmt;
use core::marker::PhantomData;

/// A cell that stays empty.
pub(crate) struct Late<T>(PhantomData<fn() -> T>);

impl<T> Late<T> {
    pub(crate) const fn new() -> Self {
        Self(PhantomData)
    }

    pub(crate) fn set(&self, value: T) -> Result<(), T> {
        Err(value)
    }

    pub(crate) fn get(&self) -> Option<&T> {
        None
    }
}

/// A handle to which nobody delivers.
pub(crate) trait Deliver<W: ?Sized>: Send + Sync {
    /// Not called.
    fn deliver(
        &self,
        message: &Shared,
        info: &SampleInfo,
    ) -> (DeliveryOutcome, Option<Arc<Doorbell<W>>>);
}

/// There is none.
pub struct LocalReader<W: ?Sized>(Infallible, PhantomData<fn(&W)>);

impl<W: ?Sized> LocalReader<W> {
    pub(crate) fn of<M: 'static>(_: &Arc<impl Deliver<W> + 'static>) -> Option<Self> {
        None
    }

    pub(crate) fn takes(&self, _: &Shared) -> bool {
        false
    }

    pub(crate) fn deliver(
        &self,
        _: &Shared,
        _: &SampleInfo,
    ) -> Option<(DeliveryOutcome, Option<Arc<Doorbell<W>>>)> {
        None
    }
}

impl<W: ?Sized> fmt::Debug for LocalReader<W> {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {}
    }
}
