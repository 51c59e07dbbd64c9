//! Output of a run: progress on the terminal, and figures.

pub(crate) mod figure;
pub(crate) mod picture;
pub(crate) mod progress;
pub(crate) mod timeline;
