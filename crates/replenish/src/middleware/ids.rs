//! Numbers of readers and writers.

/// A reader of one middleware: small, dense, given out from 0 upwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ReaderId(pub u16);

/// A writer of one middleware: small, dense, given out from 0 upwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WriterId(pub u16);
