//! [`Content`]: the kinds of what a writer sends.

/// The kind of what a writer sends: a caller may bound the time for repairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// Samples for the first time, and heartbeats.
    New,
    /// Samples and fragments that readers ask for again.
    Repairs,
}
