//! `cargo xtask circles`: files of a crate that import each other.
//!
//! ```text
//!   tree: modules, what each defines and names ──► resolve: which file defines a name
//!                                                       └──► graph: the circles
//! ```
//! A file imports another if it names something that the other defines, through `use`, a path or
//! the tokens of a macro. A `mod.rs` that only declares and re-exports is transparent. Tests are
//! left out.

mod command;
mod graph;
mod resolve;
mod tree;

pub(crate) use command::run;
