//! [`Offer`]: memory that a writer offers to a reader.

#[cfg(feature = "shared")]
use crate::wire::SegmentName;

/// Memory that a writer offers to a reader.
#[cfg(feature = "shared")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Offer {
    pub(super) name: SegmentName,
    /// Whether it could be opened, if that was tried.
    pub(super) open: Option<bool>,
    /// The writer is to hear whether references are taken.
    pub(super) say: bool,
}

/// There is no such memory.
#[cfg(not(feature = "shared"))]
#[derive(Clone, Copy, Debug)]
pub(crate) enum Offer {}
