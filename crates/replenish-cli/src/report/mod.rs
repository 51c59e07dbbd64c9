//! What a run leaves behind: tables for the terminal, figures, and files.

pub(crate) mod figure;
pub(crate) mod files;
pub(crate) mod html;
pub(crate) mod progress;
pub(crate) mod table;
pub(crate) mod timeline;
