//! Reports of an executor about itself while it runs.
//!
//! ```text
//!   hook: Events ──► logged: the program's logger (feature log)   │ logged_disabled
//!      └──────────► platform: standard error
//!   kinds: Event
//! ```

mod hook;
mod kinds;
#[cfg_attr(not(any(test, feature = "log")), path = "logged_disabled.rs")]
mod logged;

pub(crate) use hook::Events;
pub use kinds::Event;
