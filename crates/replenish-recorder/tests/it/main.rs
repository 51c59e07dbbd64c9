//! The ring and the file, from outside.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod board;
mod file;
mod ring;
