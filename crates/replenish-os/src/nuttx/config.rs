//! The sizes of this back end.

/// Pending replenishments of a budget at most: 16 bytes each.
pub(crate) const MAX_REPL: usize = if cfg!(nuttx_host) { 128 } else { 16 };
/// Budgeted workers of an enforcer unless its configuration says otherwise.
pub(crate) const ENFORCER_CAPACITY: usize = 8;
/// Stack of an enforcer in bytes.
pub(crate) const ENFORCER_STACK: usize = 4096;
/// Whether blocking inside callbacks is always seen exactly.
pub(crate) const ALWAYS_EXACT: bool = false;
/// Number of a worker's newest overruns that are kept.
pub(crate) const OVERRUNS_KEPT: usize = if cfg!(nuttx_host) { 1024 } else { 16 };

/// The policies of this system, for the refusal of any other.
pub(crate) const POLICIES: &str = "NuttX has FIFO, round-robin (CONFIG_RR_INTERVAL), \
                                   SCHED_SPORADIC (CONFIG_SCHED_SPORADIC), and sporadic by the \
                                   enforcer";
