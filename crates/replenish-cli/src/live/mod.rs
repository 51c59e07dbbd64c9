//! Programs of this host as their recordings show them: other programs' files, which are not
//! believed.
//!
//! ```text
//!   directories ──► files: opened without following links, read by place ──► programs
//! ```

mod directories;
mod program;

pub(crate) use program::{Found, Program, all, select};
