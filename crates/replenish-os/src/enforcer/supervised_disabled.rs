//! Stand-in for watchdog and recorder, which this build does not have.

use super::config::AnyServer;
use super::views::Views;
use crate::backend::blocking_detector::Switch;
use crate::{Level, Nanos, Tid};
use sporadic::{Params, Reservation};

#[derive(Debug)]
pub(super) struct Supervised;

impl Supervised {
    pub(super) const fn of(_: Tid, _: &Params) -> Self {
        Self
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn end(&self) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn show(&self, _: &Views, _: usize) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_above_its_own(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn is_refused(&self) -> bool {
        false
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn note(&self, _: Option<u8>, _: bool) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn record_as(&mut self, _: u8) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) fn switches(&mut self) -> impl FnMut(Nanos, Switch) + use<> {
        |_, _| ()
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn turned(&mut self, _: &Reservation<AnyServer>, _: Nanos, _: bool) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn observed(&mut self, _: &Reservation<AnyServer>, _: Nanos, _: bool) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(super) const fn applied(
        &mut self,
        _: &Reservation<AnyServer>,
        _: Nanos,
        _: Level,
        _: Nanos,
    ) {
    }
}
