//! In the place of `rtt` in builds without that feature: nothing is measured, nothing is known.

use crate::Nanos;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rtt {}

#[expect(
    clippy::unused_self,
    reason = "the signatures of what it stands in for"
)]
impl Rtt {
    pub(super) const fn sample(self, _: Nanos) {}

    pub(super) const fn sample_at_most(self, _: Nanos) {}

    pub(super) const fn timeout(self) -> Option<Nanos> {
        None
    }
}
