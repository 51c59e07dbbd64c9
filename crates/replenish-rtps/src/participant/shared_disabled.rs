//! No memory is shared: what would name it cannot come.

use super::state::Participant;
use crate::wire::{GuidPrefix, Nanos, Reference, Shared, Timestamp};

#[expect(clippy::unused_self, reason = "as with the feature `shared`")]
impl Participant {
    pub(super) const fn refer(
        &mut self,
        _: GuidPrefix,
        body: &Reference<'_>,
        _: Option<Timestamp>,
        _: Nanos,
    ) {
        match body.0 {}
    }

    pub(super) const fn share(&mut self, _: GuidPrefix, body: &Shared) {
        match *body {}
    }
}
