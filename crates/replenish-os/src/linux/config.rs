//! The sizes of this back end.

/// The error of a refused system call.
pub(crate) type OsError = std::io::Error;

/// Pending replenishments of a budget at most.
pub(crate) const MAX_REPL: usize = 128;
/// Budgeted workers of an enforcer unless its configuration says otherwise.
pub(crate) const ENFORCER_CAPACITY: usize = 64;
/// Stack of an enforcer in bytes.
pub(crate) const ENFORCER_STACK: usize = 256 * 1024;
/// Whether blocking inside callbacks is always seen exactly.
pub(crate) const ALWAYS_EXACT: bool = false;
/// Number of a worker's newest overruns that are kept.
pub(crate) const OVERRUNS_KEPT: usize = 1024;
