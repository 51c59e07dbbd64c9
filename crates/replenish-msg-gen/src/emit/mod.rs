//! Rust text: a file per interface, and one that includes them all.
//!
//! ```text
//!   root ─── includes ──► interface ──► message ──► fields
//!                             └──── settings, text ────┘
//! ```

mod fields;
mod interface;
mod message;
mod root;
mod settings;
mod text;

pub(crate) use root::{file, root};
pub(crate) use settings::{Emit, Owned};
