//! The sizes of this back end.

/// Pending replenishments of a budget at most: 16 bytes each.
pub(crate) const MAX_REPL: usize = 10;
/// Budgeted workers of an enforcer unless its configuration says otherwise.
pub(crate) const ENFORCER_CAPACITY: usize = 8;
/// Stack of an enforcer in bytes.
pub(crate) const ENFORCER_STACK: usize = 3072;
/// Whether blocking inside callbacks is always seen exactly.
pub(crate) const ALWAYS_EXACT: bool = true;
/// Number of a worker's newest overruns that are kept.
pub(crate) const OVERRUNS_KEPT: usize = 8;

/// The policies of this kernel, for the refusal of any other.
pub(crate) const POLICIES: &str = "FreeRTOS has FIFO, and sporadic by the enforcer";
