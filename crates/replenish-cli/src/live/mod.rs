//! Programs of this host as their recordings show them: other programs' files, which are not
//! believed.
//!
//! ```text
//!   directories ──► files: opened without following links, read by place ──► programs
//!                └► boards: the clients of agents
//! ```

mod boards;
mod directories;
mod program;

pub(crate) use boards::{Board, Boards, Recorded, boards};
pub(crate) use program::{Found, Program, all, select};
