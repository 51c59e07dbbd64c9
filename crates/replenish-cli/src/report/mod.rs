//! Results: tables for the terminal, pages, and files.

pub mod files;
pub mod html;
pub mod table;
