//! In the place of `restore` in builds without the feature `delivery`: no sample is kept, and
//! requests go on their own stream from the start.

use crate::SeqNum;
use crate::stream::{OutputReliable, OutputStats, Reliability, StreamHeader};
use crate::time::{NEVER, Nanos};
use core::marker::PhantomData;

#[derive(Debug)]
pub(super) struct Restore<S, const N: usize>(PhantomData<S>);

#[expect(
    clippy::unused_self,
    reason = "the signatures of what it stands in for"
)]
impl<S, const N: usize> Restore<S, N> {
    pub(super) fn new(_: S, _: usize, _: StreamHeader, _: Reliability) -> Self {
        Restore(PhantomData)
    }

    pub(super) const fn keeps(_: &S, _: usize) -> bool {
        false
    }

    pub(super) const fn limit(&self) -> usize {
        0
    }

    pub(super) const fn begin(&self, _: StreamHeader, _: bool) {}

    pub(super) const fn end(&self) -> Option<SeqNum> {
        None
    }

    pub(super) const fn active(&self) -> Option<&mut OutputReliable<S, N>> {
        None
    }

    pub(super) const fn is_idle(&self) -> bool {
        true
    }

    pub(super) const fn is_active(&self) -> bool {
        false
    }

    pub(super) const fn deadline(&self) -> Nanos {
        NEVER
    }

    pub(super) fn stats(&self) -> OutputStats {
        OutputStats::default()
    }
}
