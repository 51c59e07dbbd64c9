//! Programs of this host as their recordings show them: other programs' files, which are not
//! believed.
//!
//! ```text
//!   directories ──► files: opened without following links, read by place ──► programs
//!                                                                  └► timeline
//!                └► boards: the clients of agents                               └► chain
//! ```

mod boards;
mod chain;
mod directories;
mod program;
pub(crate) mod timeline;

pub(crate) use boards::{Board, Boards, Recorded, boards};
pub(crate) use chain::ChainJson;
pub(crate) use program::{Found, Program, all, select};
