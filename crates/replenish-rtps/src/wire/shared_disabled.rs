//! No memory is shared: a place in it does not exist, and so no submessage that names one.

use super::{Reader, WireError, Writer};
use core::convert::Infallible;
use core::marker::PhantomData;

/// The name of a writer's memory: there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentName {}

impl SegmentName {
    pub(super) const fn decode(_: &mut Reader<'_>) -> Option<Self> {
        None
    }

    pub(super) const fn encode(self, _: &mut Writer<'_>) {
        match self {}
    }
}

/// The place of a sample in the memory of its writer: there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SharedPlace {}

/// A sample in the memory of its writer: there is none.
#[derive(Clone, Copy, Debug)]
pub struct Reference<'a>(pub Infallible, PhantomData<&'a ()>);

/// A reader says whether it takes references: none does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shared {}

#[expect(clippy::unnecessary_wraps, reason = "as with the feature `shared`")]
pub(super) fn decode<'a, T>(
    _: u8,
    _: u8,
    _: Reader<'a>,
    _: impl FnOnce(Reference<'a>) -> T,
    _: impl FnOnce(Shared) -> T,
) -> Result<Option<T>, WireError> {
    Ok(None)
}
