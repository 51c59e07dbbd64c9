//! The `replenish` command.
fn main() {}
