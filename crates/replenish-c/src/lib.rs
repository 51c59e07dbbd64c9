//! `libreplenish`: CPU budgets for threads of C and C++ programs, by a C interface.
//!
//! ```text
//!   C, C++ ─► api ─ pointers checked, panics caught: the only module with `unsafe`
//!              │ ├─► layout   structs that C sees, with their sizes
//!              │ └─► status   codes, and the text of a thread's last error
//!              ▼
//!   replenish_threads ─ the budgets of this process
//! ```
//!
//! `include/replenish.h` is made from this source; a test compares it. Linux only.

mod api;
mod layout;
mod status;

pub use api::{
    replenish_budget_attach, replenish_budget_detach, replenish_budget_list, replenish_budget_new,
    replenish_budget_release, replenish_budget_usage, replenish_check_version,
    replenish_last_error, replenish_mark, replenish_mark_new, replenish_options_init,
    replenish_status_name, replenish_thread_id, replenish_version,
};
pub use layout::{
    Options, REPLENISH_ANY_CPU, REPLENISH_IDLE, REPLENISH_NAME, REPLENISH_OTHER, REPLENISH_SUSPEND,
    Usage,
};
pub use status::{
    REPLENISH_BUSY, REPLENISH_FORKED, REPLENISH_FULL, REPLENISH_INTERNAL, REPLENISH_INVALID,
    REPLENISH_NOT_FOUND, REPLENISH_NOT_PERMITTED, REPLENISH_OK, REPLENISH_REFUSED,
    REPLENISH_SYSTEM, REPLENISH_UNSUPPORTED, REPLENISH_VERSION,
};
